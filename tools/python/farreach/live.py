"""A running rig, observed.

An observer only subscribes: one that is slow, stopped or killed disturbs nothing. What it does not
take in time is overwritten, and counted in `Subscription.lost`.
"""

import ctypes
import fcntl
import os
import time
import tomllib
from pathlib import Path

import numpy as np

from .errors import FarreachError, LayoutError, RigEnded, RigNotUp
from .layout import layout_of

# How often a waiting subscriber looks for messages (s).
POLL_S = 0.001
# How often it looks whether the rig still runs (s).
SESSION_CHECK_S = 0.2
# The library's configuration is one for the whole process.
_configured = None


def connect(rig_name=None):
    """Joins a rig that is up, as an observer.

    `rig_name` is the rig's name: by default that of `FARREACH_RIG_NAME`, else `farreach`. It must
    run as the same user. A process observes one rig in its life.

    Raises `RigNotUp`.
    """
    return Rig(rig_name or os.environ.get("FARREACH_RIG_NAME") or "farreach")


class Rig:
    """A rig that is up."""

    def __init__(self, name):
        global _configured
        try:
            import iceoryx2
        except ImportError as error:
            raise FarreachError(
                "live data need the package iceoryx2: pip install \"farreach[live]\""
            ) from error
        self._iox2 = iceoryx2
        self.name = name
        self.directory = Path(f"/dev/shm/farreach-{os.geteuid()}-{name}")
        session = self._read_session() if self._has_keeper() else None
        if session is None:
            raise RigNotUp(
                f"no rig \"{name}\" of this user is up: expected one in {self.directory}; start it "
                f"with `farreach up`, or give the name of another one"
            )
        self.session = session
        # With each session the names of the segments change, and with them the configuration.
        if _configured not in (None, (name, session)):
            raise FarreachError(
                f"this process has joined the rig \"{_configured[0]}\" (session "
                f"{_configured[1]:016x}) before, and can join no other: start a new process"
            )
        iceoryx2.set_log_level(iceoryx2.LogLevel.Error)
        if _configured is None:
            configuration = iceoryx2.FilePath.new(str(self.directory / "iceoryx2.toml"))
            iceoryx2.config.setup_global_config_from_file(configuration)
            _configured = (name, session)
        self._node = (
            iceoryx2.NodeBuilder.new()
            .config(iceoryx2.config.global_config())
            .name(iceoryx2.NodeName.new("python"))
            .signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
            .create(iceoryx2.ServiceType.Ipc)
        )
        self._subscriptions = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Leaves the rig. Without it, that happens at the end of the process."""
        for subscription in self._subscriptions:
            subscription.close()
        self._subscriptions.clear()
        # The library deletes a node with its last reference.
        self._node = None

    def is_up(self):
        """Whether the session that was joined still runs."""
        return self._read_session() == self.session

    def subscribe(self, topic):
        """Subscribes to a topic, such as `sample` (see `farreach.topics`).

        Raises `NoSuchTopic`, and `LayoutError` where the rig runs a version of farreach whose
        messages are others.
        """
        if self._node is None:
            raise FarreachError(f"the connection to rig \"{self.name}\" is closed")
        layout = layout_of(topic)
        iox2 = self._iox2
        structure = layout.structure()
        name = iox2.ServiceName.new(topic)
        try:
            service = self._node.service_builder(name).publish_subscribe(structure).open()
            port = service.subscriber_builder().create()
        except Exception as error:
            # The library's errors have no common type.
            if not self.is_up():
                raise RigEnded(f"rig \"{self.name}\" has ended") from error
            raise LayoutError(
                f"topic {topic}: cannot be opened as {layout.type_name} ({error}); this package "
                f"must be of the same version as the rig, and a topic has a limited number of "
                f"subscribers"
            ) from error
        subscription = Subscription(self, topic, layout, structure, port)
        self._subscriptions.append(subscription)
        return subscription

    def _has_keeper(self):
        """The keeper holds its lock exclusively for as long as it lives. What a killed rig leaves
        behind is no rig."""
        try:
            with open(self.directory / "keeper.lock", "r+b") as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False

    def _read_session(self):
        try:
            text = (self.directory / "session.toml").read_text(encoding="utf-8")
            return int(tomllib.loads(text)["session"], 16)
        except (FileNotFoundError, PermissionError, tomllib.TOMLDecodeError, KeyError, ValueError):
            return None


class Subscription:
    """Messages of a topic, from when it was subscribed to."""

    def __init__(self, rig, topic, layout, structure, port):
        self.rig = rig
        self.topic = topic
        self.layout = layout
        self.received = 0
        """Messages that were taken."""
        self.lost = 0
        """Messages that were overwritten before they were taken: gaps in their sequence."""
        self._structure = structure
        self._port = port
        self._next = {}
        self._checked_s = time.monotonic()

    def read(self, seconds=None, count=None):
        """What comes within `seconds` (s), or `count` messages, whichever is first: a structured
        array with a field for each field of the message. Without either, what is waiting.

        Raises `RigEnded`.
        """
        if count is not None and count < 1:
            raise ValueError(f"count {count}: expected 1 or more")
        if seconds is not None and not seconds >= 0:
            raise ValueError(f"seconds {seconds}: expected 0 or more")
        taken = bytearray()
        most = None if count is None else count * self.layout.size
        end_s = None if seconds is None else time.monotonic() + seconds
        while True:
            self._take(taken, most)
            enough = most is not None and len(taken) >= most
            over = end_s is not None and time.monotonic() >= end_s
            if enough or over or (count is None and seconds is None):
                return np.frombuffer(taken, dtype=self.layout.dtype)
            self._check()
            time.sleep(POLL_S)

    def latest(self, timeout=1.0):
        """The newest message; waits up to `timeout` (s) where none has come since the last call.
        `None` if none came.

        Raises `RigEnded`.
        """
        waiting = self.read()
        if len(waiting) == 0:
            waiting = self.read(seconds=timeout, count=1)
        return waiting[-1] if len(waiting) else None

    def blocks(self, seconds):
        """Endless: what came in each `seconds` (s), one array after the other, until the rig ends
        (`RigEnded`)."""
        while True:
            yield self.read(seconds=seconds)

    def close(self):
        """Ends the subscription."""
        if self._port is not None:
            self._port.delete()
            self._port = None

    def _take(self, taken, most):
        """Appends what is waiting, up to `most` bytes in all."""
        if self._port is None:
            raise FarreachError(f"the subscription to {self.topic} is closed")
        while most is None or len(taken) < most:
            message = self._port.receive()
            if message is None:
                return
            payload = message.payload().contents
            taken += ctypes.string_at(ctypes.addressof(payload), self.layout.size)
            self._count(payload.incarnation, payload.sequence)
            message.delete()

    def _count(self, incarnation, sequence):
        self.received += 1
        expected = self._next.get(incarnation)
        # What was sent before the first one that came is not lost.
        if expected is not None and sequence > expected:
            self.lost += sequence - expected
        self._next[incarnation] = sequence + 1

    def _check(self):
        now_s = time.monotonic()
        if now_s - self._checked_s < SESSION_CHECK_S:
            return
        self._checked_s = now_s
        if not self.rig.is_up():
            raise RigEnded(f"rig \"{self.rig.name}\" has ended")

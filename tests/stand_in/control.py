#!/usr/bin/env python3
"""A control process for farreach, written from its published files alone.

Uses docs/schemas/*.msg for the layouts, docs/topics.md for the names of the topics, and
docs/replacing.md for the rest. Holds the handle of axis 0 at a position by proportional feedback.

    pip install iceoryx2==0.10.*
    farreach-control.py --rig-name NAME --schemas docs/schemas --target-rad 0.6

Ends on SIGTERM, or when the session of the rig has ended.
"""

import argparse
import ctypes
import fcntl
import os
import re
import secrets
import signal
import socket
import sys
import time
import tomllib
from pathlib import Path

import iceoryx2 as iox2

PERIOD_NS = 2_000_000
PHASE_NS = 200_000
# Codes of the checkpoints that control passes in each cycle, in order.
CHECKPOINTS = bytes([16, 17, 18, 19])
NUMBERS = {
    "int8": ctypes.c_int8,
    "uint8": ctypes.c_uint8,
    "int16": ctypes.c_int16,
    "uint16": ctypes.c_uint16,
    "int32": ctypes.c_int32,
    "uint32": ctypes.c_uint32,
    "int64": ctypes.c_int64,
    "uint64": ctypes.c_uint64,
    "float32": ctypes.c_float,
    "float64": ctypes.c_double,
}


def message(path):
    """The structure that a .msg file describes, and its constants."""
    text = path.read_text()
    head = re.sub(r"\n# ?", " ", text[: text.index("\n\n")])
    size, name = re.search(r"(\d+) bytes, (farreach\.\w+\.v\d+) in shared memory", head).groups()
    fields, constants = [], {}
    for line in text.splitlines():
        constant = re.match(r"\w+ (\w+)=(\d+)$", line)
        field = re.match(r"(\w+)(?:\[(\d+)\])? (\w+)$", line)
        if constant:
            constants[constant[1]] = int(constant[2])
        elif field:
            number = NUMBERS[field[1]]
            fields.append((field[3], number * int(field[2]) if field[2] else number))
    kind = type(
        path.stem,
        (ctypes.Structure,),
        {"_fields_": fields, "type_name": staticmethod(lambda: name)},
    )
    if ctypes.sizeof(kind) != int(size):
        sys.exit(f"{path}: {ctypes.sizeof(kind)} bytes, expected {size}")
    return kind, constants


def flow(challenge):
    """The signature of a cycle: FNV-1a of the checkpoints and the challenge, folded to 16 bits."""
    state = 0x811C9DC5
    for byte in CHECKPOINTS + challenge.to_bytes(8, "little"):
        state = (state ^ byte) * 0x01000193 & 0xFFFFFFFF
    return state >> 16 ^ state & 0xFFFF


def newest(subscriber, kind):
    """A copy of the newest message since the last call; None if none came."""
    found = None
    while (sample := subscriber.receive()) is not None:
        found = kind.from_buffer_copy(sample.payload().contents)
        sample.delete()
    return found


def notify(text):
    """Tells the service manager, where there is one."""
    address = os.environ.get("NOTIFY_SOCKET")
    if address:
        address = "\0" + address[1:] if address[0] == "@" else address
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as to:
            to.sendto(text.encode(), address)


class Rig:
    """The shared-memory domain of a rig, joined."""

    def __init__(self, name):
        self.directory = Path(f"/dev/shm/farreach-{os.geteuid()}-{name}")
        # Held for as long as this process lives: it keeps the session.
        self.alive = open(self.directory / "alive.lock", "r+b")
        fcntl.flock(self.alive, fcntl.LOCK_SH)
        iox2.set_log_level(iox2.LogLevel.Error)
        configuration = self.directory / "iceoryx2.toml"
        iox2.config.setup_global_config_from_file(iox2.FilePath.new(str(configuration)))
        self.session = self.read_session()
        self.node = (
            iox2.NodeBuilder.new()
            .config(iox2.config.global_config())
            .name(iox2.NodeName.new("control"))
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
            .create(iox2.ServiceType.Ipc)
        )

    def read_session(self):
        try:
            text = (self.directory / "session.toml").read_text()
        except FileNotFoundError:
            return None
        return int(tomllib.loads(text)["session"], 16)

    def topic(self, name, kind):
        builder = self.node.service_builder(iox2.ServiceName.new(name))
        return builder.publish_subscribe(kind).open()


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--rig-name", default=os.environ.get("FARREACH_RIG_NAME", "farreach"))
    options.add_argument("--schemas", type=Path, required=True)
    options.add_argument("--target-rad", type=float, default=0.6)
    options.add_argument("--gain-v-per-rad", type=float, default=12.0)
    options.add_argument("--volts-max", type=float, default=4.0)
    options = options.parse_args()

    Sample, sample_codes = message(options.schemas / "Sample.msg")
    EnableToken, _ = message(options.schemas / "EnableToken.msg")
    MotorCommand, command_codes = message(options.schemas / "MotorCommand.msg")
    rig = Rig(options.rig_name)
    samples = rig.topic("sample", Sample).subscriber_builder().create()
    tokens = rig.topic("token", EnableToken).subscriber_builder().create()
    commands = (
        rig.topic("command", MotorCommand)
        .publisher_builder()
        .backpressure_strategy(iox2.BackpressureStrategy.DiscardData)
        .max_loaned_samples(1)
        .create()
    )
    stopping = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopping.append(True))

    incarnation = secrets.randbits(64)
    sequence = 0
    sample = token = None
    print(f"incarnation {incarnation}", flush=True)
    notify("READY=1")
    tick = time.monotonic_ns() // PERIOD_NS
    beat_ns = 0
    while not stopping:
        # The absolute grid: what is late is skipped, never made up for.
        tick = max(tick + 1, (time.monotonic_ns() - PHASE_NS) // PERIOD_NS)
        due_ns = tick * PERIOD_NS + PHASE_NS
        while (wait_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(wait_ns * 1e-9)
        sample = newest(samples, Sample) or sample
        token = newest(tokens, EnableToken) or token
        now_ns = time.monotonic_ns()
        if now_ns - beat_ns > 200_000_000:
            beat_ns = now_ns
            notify("WATCHDOG=1")
            if rig.read_session() != rig.session:
                break
        if sample is None or token is None:
            continue
        powered = (
            token.enabled == 1
            and token.control_incarnation == incarnation
            and sample.epoch == token.epoch
            and sample.gate_state == sample_codes["GATE_STATE_OPEN"]
        )
        command = MotorCommand()
        command.session = rig.session
        command.incarnation = incarnation
        command.sequence = sequence
        command.sample_tick = sample.tick
        command.sample_time_ns = sample.scan_time_ns
        command.token_sequence = token.sequence
        command.epoch = token.epoch
        command.axes = 1
        command.feedback_factor = 1.0
        # It asks for no real-time scheduling, so that a real card would not arm with it.
        command.profile = command_codes["PROFILE_BEST_EFFORT"]
        if powered:
            wanted = options.gain_v_per_rad * (options.target_rad - sample.master_position[0])
            command.volts[0] = min(max(wanted, -options.volts_max), options.volts_max)
        command.flow = flow(command.token_sequence)
        command.computed_ns = command.time_ns = time.monotonic_ns()
        commands.send_copy(command)
        sequence += 1
    notify("STOPPING=1")


if __name__ == "__main__":
    main()

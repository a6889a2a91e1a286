"""Whether a rig with everything attached loses nothing and stays as it is: part of measure.py.

While the handle moves: a recording in parts, the monitor, the console with both of its pages, the
bridge to Foxglove with a viewer of all topics, and probes. Once a minute the memory of each process
is noted. Needs `pip install websockets`.
"""

import contextlib
import json
import math
import os
import pathlib
import re
import signal
import statistics
import subprocess
import threading
import time

import bare_loops
from measure_harm import Movement

EVERY_S = 60
# A rig has touched all of its memory some time after its start.
SETTLED_S = 300
LOOKERS = [
    ("probe", "echo", "sample"),
    ("probe", "echo", "timing/control"),
    ("probe", "echo", "command"),
]
SUBPROTOCOL = "foxglove.sdk.v1"
FRAME_OF_MESSAGE = 1
WAIT_S = 30
KIB_PER_MIB = 1024.0


# --- what is attached


class Client(threading.Thread):
    """Counts what a server of WebSockets sends."""

    def __init__(self, address, **options):
        super().__init__(daemon=True)
        from websockets.sync.client import connect  # the other measurements do without
        self.socket = connect(address, max_size=None, **options)
        self.address, self.frames, self.failed = address, 0, None

    def run(self):
        try:
            for frame in self.socket:
                self.received(frame)
            self.failed = "the server closed"
        except Exception as error:  # of the connection, or what a frame holds
            self.failed = repr(error)

    def received(self, frame):
        self.frames += 1

    def check(self):
        """Ends the measurement where it has failed."""
        if self.failed:
            raise RuntimeError(f"{type(self).__name__} of {self.address}: {self.failed}")

    def end(self):
        """Closes; how many frames came."""
        self.check()
        self.socket.close()
        self.join(WAIT_S)
        return self.frames


class Viewer(Client):
    """A client of the bridge to Foxglove that subscribes to all topics, and counts messages."""

    def __init__(self, address):
        super().__init__(address, subprotocols=[SUBPROTOCOL])

    def received(self, frame):
        if isinstance(frame, bytes):
            self.frames += frame[0] == FRAME_OF_MESSAGE
            return
        said = json.loads(frame)
        if said["op"] == "advertise":
            wanted = [{"id": channel["id"], "channelId": channel["id"]}
                      for channel in said["channels"]]
            self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


class Page(Client):
    """A page of the console, which answers as the page does."""

    def __init__(self, server, kind):
        super().__init__(f"ws://{server}/ws?page={kind}", origin=f"http://{server}")

    def received(self, frame):
        self.frames += 1
        said = json.loads(frame)
        if said["type"] == "clock":
            request = {"do": "echo", "server_ms": said["server_ms"],
                       "page_ms": time.monotonic() * 1e3}
            self.socket.send(json.dumps({"id": self.frames, "request": request}))


class Attached:
    """Programs that look at the rig."""

    def __init__(self, rig):
        self.rig, self.programs = rig, {}

    def start(self, *words):
        said = (self.rig.folder / f"said-{len(self.programs)}.txt").open("w+")
        self.programs[" ".join(words)] = said, subprocess.Popen(
            [self.rig.program, *words], env=self.rig.environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=said)

    def check(self):
        """Ends the measurement where one of them ended by itself."""
        for name, (said, child) in self.programs.items():
            if child.poll() is not None:
                said.seek(0)
                raise RuntimeError(f"{name} ended: {said.read().strip()}")

    def end(self):
        """Ends them as Ctrl-C does; what each said at its end."""
        told = {}
        for name, (said, child) in self.programs.items():
            child.send_signal(signal.SIGINT)
            try:
                child.wait(WAIT_S)
            except subprocess.TimeoutExpired:
                child.kill()
            said.seek(0)
            told[name] = " / ".join(said.read().split("\n")).strip(" /") or "nothing"
            said.close()
        return told


# --- memory


def processes(rig):
    """Name and process id of each process of the rig, and of all that look at it."""
    marker = f"FARREACH_RIG_NAME={rig.environment['FARREACH_RIG_NAME']}".encode()
    for entry in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            line = (entry / "cmdline").read_bytes()
            words = [word.decode(errors="replace") for word in line.split(b"\0")]
            if marker in (entry / "environ").read_bytes().split(b"\0"):
                if pathlib.Path(words[0]).name == "farreach":
                    name = words[2:3] if words[1] == "service" else words[1:4]
                    yield " ".join(name).strip(), int(entry.name)


def memory_mib(pid):
    """Proportional set size (MiB)."""
    text = pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text()
    return int(re.search(r"(?m)^Pss:\s+(\d+)", text)[1]) / KIB_PER_MIB


def note(rig, noted, after_s):
    """Adds the memory and the processor time of each process."""
    for name, pid in processes(rig):
        with contextlib.suppress(OSError):  # a command that ended meanwhile
            fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
            used_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            row = after_s, memory_mib(pid), used_s, pid
            noted.setdefault(name, []).append(row)


def slope(times, values):
    """The median of the slopes between all pairs (Theil and Sen)."""
    count = len(times)
    slopes = [(values[j] - values[i]) / (times[j] - times[i])
              for i in range(count) for j in range(i + 1, count)]
    return statistics.median(slopes) if slopes else math.nan


# --- the measurement


def watch(rig, options, attached, clients):
    """Moves the handle for so long, and notes the memory; what was noted, and trips."""
    noted, movement, began = {}, Movement(rig, options.minutes * 60), time.monotonic()
    movement.start()
    while (left := movement.until - time.monotonic()) > 0:
        note(rig, noted, time.monotonic() - began)
        attached.check()
        for client in clients:
            client.check()
        time.sleep(min(EVERY_S, left))
    movement.join()
    note(rig, noted, time.monotonic() - began)
    return noted, movement.trips


def attach(rig, attached, port):
    """Starts all that look; the clients of bridge and console."""
    attached.start("bridge", "foxglove", "--port", str(port))
    for words in LOOKERS:
        attached.start(*words)
    pages = json.loads(rig.ok("console", "--json"))
    server = pages["subject"].split("/")[2]
    until = time.monotonic() + WAIT_S
    while True:
        try:
            viewer = Viewer(f"ws://127.0.0.1:{port}/")
            break
        except OSError:
            attached.check()
            if time.monotonic() > until:
                raise
            time.sleep(0.2)
    clients = viewer, Page(server, "operator"), Page(server, "subject")
    for client in clients:
        client.start()
    return clients


def soak(rig, options):
    """A rig with everything attached, for so many minutes."""
    attached, clients = Attached(rig), []
    with rig.up("--profile", options.profile, "--monitor", f"--console={options.console}"):
        rig.ok("rec", "start", rig.folder / "soak.mcap", "--split", "10min")
        try:
            clients = attach(rig, attached, options.port)
            with bare_loops.EveryProcessor(fifo=options.profile == "realtime") as bare:
                noted, trips = watch(rig, options, attached, clients)
            frames = [client.end() for client in clients]
        finally:
            said = attached.end()
        state = json.loads(rig.ok("status", "--json"))
        stopped = rig.run("rec", "stop")
    memory(noted)
    print(f"\n- Trips: {trips}. Messages to the viewer of the bridge, the operator's page, the "
          f"subject's page: {', '.join(map(str, frames))}")
    print(f"- {bare.name}: late by p50, p99, p99.9, max "
          f"{', '.join(f'{us:.0f}' for us in bare.late_us)} µs")
    for name, text in said.items():
        print(f"- `farreach {name}`: {text}")
    losses(state)
    # Exit code 3: something was lost, which is a result.
    print(f"- `farreach rec stop`: exit code {stopped.returncode}, "
          f"{(stopped.stdout + stopped.stderr).strip()}")
    recordings(rig)


def memory(noted):
    """A table of what each process needs, and how that changes."""
    print("| process | processor | PSS after 5 min, at the end (MiB) | change (MiB an hour) |")
    print("|---|---|---|---|")
    total = {}
    for name, rows in sorted(noted.items()):
        if len(rows) < 2 or rows[0][3] != rows[-1][3]:
            continue  # a command of the measurement
        used = (rows[-1][2] - rows[0][2]) / (rows[-1][0] - rows[0][0])
        settled = [row for row in rows if row[0] >= SETTLED_S] or rows
        rising = 3600 * slope([row[0] for row in settled], [row[1] for row in settled])
        print(f"| {name} | {100 * used:.1f} % | {settled[0][1]:.1f}, {settled[-1][1]:.1f} "
              f"| {rising:+.2f} |")
        for after_s, mib, *_ in rows:
            total.setdefault(round(after_s), []).append(mib)
    ends = [sum(mib) for _, mib in sorted(total.items())]
    print(f"| all | | {ends[len(ends) > 5 and 5]:.1f}, {ends[-1]:.1f} | |")


def losses(state):
    """What the processes themselves count."""
    for process in state["processes"]:
        lost = {name: count for name, count in (process["losses"] or {}).items() if count}
        skipped, cycles = process["missed_periods"], process["cycles"]
        if cycles:
            print(f"- {process['name']}: {skipped} of {cycles} periods skipped"
                  f"{'; ' + json.dumps(lost) if lost else ''}; restarts {process['restarts']}")
    print(f"- lost before the disk: {json.dumps(state['losses'])}; "
          f"scans missed by the card {state['gate']['scans_missed']}")


def recordings(rig):
    """What `rec verify` says of each part."""
    for part in sorted(rig.folder.glob("soak*.mcap")):
        told = rig.run("rec", "verify", part, "--json")
        found = json.loads(told.stdout)
        print(f"- {part.name}: exit code {told.returncode}, {found['bytes'] / 1e6:.0f} MB, "
              f"data lost: {found['data_lost']}, ticks {json.dumps(found['ticks'])}")

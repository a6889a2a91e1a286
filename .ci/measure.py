#!/usr/bin/env python3
"""Measures a live simulated rig for the tables of docs/live-loop.md and docs/performance.md.

    cargo build --release
    cargo run --release -p tune --example tuning_table -- hydrostatic 5 FOLDER
    .ci/measure.py tune FOLDER         # tune on eight hidden effects: before, after, with the truth
    .ci/measure.py monitor             # lateness with and without the monitor, and what it costs
    .ci/measure.py protocols           # ten protocols of 60 s beside bare loops of 1 ms
    .ci/measure.py demo 31 40          # the demo with these seeds
    .ci/measure.py harm --minutes 5    # what those who look do to the rig, beside bare loops
    .ci/measure.py peers               # beside other programs that do the same, in one run
    .ci/measure.py soak --minutes 60   # losses and memory with everything attached
    .ci/measure.py chain               # higher rates, beside bare loops of the same rate

Prints rows of Markdown, with what the host did meanwhile. Let nothing else run beside it. Its rig
has a name of its own and is taken down in any case.
"""

import argparse
import contextlib
import json
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tomllib

import measure_chain
import measure_harm
import measure_peers
import measure_soak

ROOT = pathlib.Path(__file__).resolve().parent.parent
MOVEMENT = ["guided-1hz", "--set", "segments.0.duration_s=12"]
PROCESSES = ["simulator", "acquisition", "control", "watchdog", "experiment"]


class Rig:
    """A simulated rig of its own name."""

    def __init__(self, program, folder):
        self.program = str(program)
        self.folder = pathlib.Path(folder)
        self.environment = dict(
            os.environ,
            FARREACH_RIG_NAME=f"measure-{os.getpid()}",
            FARREACH_LEARNT=str(self.folder / "learnt"),
            FARREACH_DOCTOR=str(self.folder / "doctor"),
        )

    def run(self, *arguments):
        """What a command returned and printed."""
        return subprocess.run(
            [self.program, *map(str, arguments)],
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )

    def ok(self, *arguments):
        """What a command printed; ends the measurement where it fails."""
        done = self.run(*arguments)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(map(str, arguments))}: {done.stderr.strip()}")
        return done.stdout

    def absolute(self, source):
        """A rig file with encoders that keep their zero, which need no search for the stops."""
        text = pathlib.Path(source).read_text()
        text, found = re.subn(r"(?m)^method = \"stops\".*\n(?:\w+ = .*\n)*",
                              'method = "absolute"\n', text)
        if found == 0:
            raise RuntimeError(f"{source}: no axis is homed at its stops")
        file = self.folder / f"absolute-{pathlib.Path(source).name}"
        file.write_text(text)
        return file

    @contextlib.contextmanager
    def up(self, *options, homes=True):
        """The rig, up and homed, within a `with`."""
        self.ok("up", "--simulate", *options)
        try:
            if homes:
                self.home()
            else:
                self.arm()
            yield self
        finally:
            self.run("down")

    def arm(self):
        """Resets and arms, once the faults of the start, or of a trip, have cleared."""
        for _ in range(60):
            self.run("disarm")
            self.run("reset")
            if self.run("arm").returncode == 0:
                return
            time.sleep(0.5)
        raise RuntimeError(self.run("arm").stderr.strip())

    def home(self):
        """Arms and homes, again where a stall of the host trips it, rightly."""
        for _ in range(30):
            self.arm()
            homed = self.run("run", "home")
            if homed.returncode == 0:
                return
        raise RuntimeError(f"run home: {homed.stderr.strip()}")

    def play(self, *protocol):
        """Runs a protocol."""
        return self.run("run", *protocol)

    def play_through(self, back, *protocol):
        """Runs a protocol to its end, again after `back` where a stall of the host trips it."""
        for _ in range(5):
            done = self.play(*protocol)
            if done.returncode == 0:
                return
            print(f"again: {done.stderr.strip()}", file=sys.stderr)
            back()
        raise RuntimeError(f"{' '.join(protocol)}: {done.stderr.strip()}")


BARE_LOOP = """
import json, os, select, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
above, worst, cycles, due = {2: 0, 12: 0, 40: 0}, 0.0, 0, time.monotonic()
while cycles % 500 or not select.select([sys.stdin], [], [], 0)[0]:
    cycles += 1
    due += 0.001
    time.sleep(max(0.0, due - time.monotonic()))
    late_ms = (time.monotonic() - due) * 1e3
    worst = max(worst, late_ms)
    for limit in above:
        above[limit] += late_ms > limit
    if late_ms > 1.0:
        due = time.monotonic()
print(json.dumps({"above": above, "worst_ms": worst}))
"""


class BareLoops:
    """A bare loop of 1 ms on each processor: what the host takes from everybody."""

    def __init__(self):
        # Processes: threads of one interpreter would wait for each other.
        self.children = [
            subprocess.Popen([sys.executable, "-c", BARE_LOOP, str(processor)],
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            for processor in sorted(os.sched_getaffinity(0))
        ]
        self.found = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.found = [json.loads(child.communicate("\n")[0]) for child in self.children]

    def told(self):
        """Pauses of the loops, in words."""
        above = ", ".join(
            f"{sum(found['above'][str(ms)] for found in self.found)} times more than {ms} ms"
            for ms in (2, 12, 40))
        worst_ms = max(found["worst_ms"] for found in self.found)
        return (f"bare loops of 1 ms on {len(self.found)} processors woke late {above}, "
                f"{worst_ms:.1f} ms at most")


def hidden_effect(file):
    """The effect that a rig file of the example tuning_table declares, as `--effect` takes it."""
    effect, = tomllib.loads(file.read_text())["model"]["effects"]
    size, = effect["parameters"].values()
    return f"{effect['id']}@{effect['site']}={size}"


def tune(rig, options):
    """Tracking error of the live rig before and after `tune`, and with a control that knows."""
    example = ROOT / "target/release/examples/tracking_error"
    print("| hidden effect | found | before | with the proposal: predicted, measured "
          "| control that knows the truth | ratio |")
    print("|---|---|---|---|---|---|")
    for number, truth_file in enumerate(sorted(options.folder.glob("*-truth.toml"))):
        effect = hidden_effect(truth_file)
        # A line that leaks so much gives no zero: it does not come to rest against a stop.
        homes = not effect.startswith("leakage")
        shipped = ROOT / "launch/rigs/hydrostatic.toml"
        with rig.up("--rig", shipped if homes else rig.absolute(shipped), "--effect", effect,
                    homes=homes):
            out = rig.folder / f"tuned-{number}"
            told = json.loads(rig.ok("tune", "--yes", "--json", "--out", out))
        found = ", ".join(told["effects"]) or told["verdict"]
        named = "it" if found == effect.split("=")[0] else found
        known = rig.folder / f"known-{number}.mcap"
        knowing = truth_file.with_name(truth_file.name.replace("-truth", "-knowing"))
        files = {"knowing": knowing, "truth": truth_file}
        if not homes:
            files = {what: rig.absolute(file) for what, file in files.items()}
        with rig.up("--rig", files["knowing"], "--machine", files["truth"], "--record", known,
                    homes=homes):
            # As `tune` does: what a movement leaves behind acts on the next. The excitation is
            # meant for the control before: with that of a soft line it may reach a limit.
            back = rig.home if homes else rig.arm
            rig.play_through(back, *MOVEMENT)
            if rig.play("tuning-excitation").returncode != 0:
                back()
            rig.play_through(back, *MOVEMENT)
        line = subprocess.run([example, *MOVEMENT[:1], MOVEMENT[2], known], check=True,
                              stdout=subprocess.PIPE, text=True).stdout
        truth = float(line.split("rms ")[1].split("°")[0])
        before, predicted, after = (math.degrees(told[key]["rms"])
                                    for key in ("before", "after_predicted", "after"))
        print(f"| `{effect}` | {named} | {before:.2f}° | {predicted:.2f}°, {after:.2f}° "
              f"| {truth:.2f}° | {after / truth:.2f} |", flush=True)


def monitor(rig, options):
    """Lateness of the loops with and without the monitor, by turns, and the monitor's own cost."""
    found = {}
    for repeat in range(options.repeats):
        for profile in ("realtime", "best-effort"):
            for more in ([], ["--monitor"]):
                file = rig.folder / "lateness.mcap"
                with rig.up("--profile", profile, "--record", file, *more):
                    rig.play(*MOVEMENT)
                for process, late in lateness(rig, file).items():
                    found.setdefault((profile, bool(more), process), []).append(late)
                file.unlink()
        print(f"round {repeat + 1} of {options.repeats}", file=sys.stderr)
    print("| process | realtime, without: p50, p99 | with | best-effort, without: p50, p99 "
          "| with |\n|---|---|---|---|---|")
    for process in PROCESSES:
        columns = [spread(found[profile, with_it, process])
                   for profile in ("realtime", "best-effort") for with_it in (False, True)]
        print(f"| {process} | {' | '.join(columns)} |")
    for profile in ("realtime", "best-effort"):
        with rig.up("--profile", profile, "--monitor"):
            pid = monitors_pid(rig)
            play = threading.Thread(
                target=rig.play, args=("guided-1hz", "--set", "segments.0.duration_s=85"))
            began, used = time.monotonic(), processor_time_s(pid)
            play.start()
            time.sleep(90)
            used = (processor_time_s(pid) - used) / (time.monotonic() - began)
            play.join()
            print(f"monitor, {profile}: {100 * used:.2f} % of a core")


def lateness(rig, file):
    """Lateness of every wake of each process, p50 and p99 since its start (µs)."""
    last = {}
    for process in PROCESSES:
        lines = rig.ok("rec", "cat", file, "--json", "--topic", f"timing/{process}").splitlines()
        last[process] = [ns / 1e3 for ns in json.loads(lines[-1])["fields"]["total_wake_late_ns"]]
    return last


def spread(runs):
    """Median and range of p50 and p99 over the runs (µs)."""
    def of(values):
        return f"{statistics.median(values):.0f} ({min(values):.0f}–{max(values):.0f})"
    return f"{of([late[0] for late in runs])}, {of([late[1] for late in runs])}"


def monitors_pid(rig):
    """Process id of the rig's monitor."""
    name = rig.environment["FARREACH_RIG_NAME"]
    for entry in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (entry / "cmdline").read_bytes().split(b"\0")
            ours = f"FARREACH_RIG_NAME={name}".encode() in (entry / "environ").read_bytes()
            if ours and words[1:3] == [b"service", b"monitor"]:
                return int(entry.name)
    raise RuntimeError("the rig has no monitor")


def processor_time_s(pid):
    """Processor time that a process has used (s)."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def protocols(rig, options):
    """Protocols of 60 s, one after the other, and what the host did meanwhile."""
    completed = 0
    file = rig.folder / "protocols.mcap"
    with BareLoops() as bare, rig.up("--profile", options.profile, "--record", file):
        for repeat in range(options.repeats):
            rig.arm()
            done = rig.play("guided-1hz", "--set", "segments.0.duration_s=60")
            completed += done.returncode == 0
            print(f"{repeat + 1}: exit code {done.returncode} {done.stderr.strip()[-200:]}",
                  flush=True)
    print(f"{completed} of {options.repeats} completed ({options.profile}); {bare.told()}")
    print(rig.run("rec", "verify", file).stdout)


def demo(rig, options):
    """The demo with seeds in a row: what was hidden, what was named, tracking error."""
    print("| seed | hidden | found | naming | handle before, after | took |")
    print("|---|---|---|---|---|---|")
    for seed in range(options.first, options.last + 1):
        began = time.monotonic()
        out = rig.folder / f"demo-{seed}"
        rig.ok("demo", "--seed", seed, "--out", out)
        took = time.monotonic() - began
        told = json.loads((out / "summary.json").read_text())
        loop = told["closed_loop"]
        found = ", ".join(loop["effects"]) or loop["verdict"]
        before, after = (math.degrees(loop[key]["rms"]) for key in ("before", "after"))
        print(f"| {seed} | `{told['injected']}` | {found} | {loop['naming']} "
              f"| {before:.2f}°, {after:.2f}° | {took:.0f} s |", flush=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=pathlib.Path,
                        default=ROOT / "target/release/farreach")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for what is recorded")
    what = parser.add_subparsers(dest="what", required=True)
    what.add_parser("tune").add_argument("folder", type=pathlib.Path)
    what.add_parser("monitor").add_argument("--repeats", type=int, default=6)
    ten = what.add_parser("protocols")
    ten.add_argument("--repeats", type=int, default=10)
    ten.add_argument("--profile", default="best-effort", choices=("realtime", "best-effort"))
    seeds = what.add_parser("demo")
    seeds.add_argument("first", type=int)
    seeds.add_argument("last", type=int)
    arms = what.add_parser("harm")
    arms.add_argument("--minutes", type=float, default=2.0, help="of each arm")
    arms.add_argument("--rounds", type=int, default=5, help="repeats of each arm")
    arms.add_argument("--profile", default="realtime", choices=("realtime", "best-effort"))
    measure_peers.add_arguments(what.add_parser("peers"))
    long = what.add_parser("soak")
    long.add_argument("--minutes", type=float, default=60.0)
    long.add_argument("--profile", default="realtime", choices=("realtime", "best-effort"))
    long.add_argument("--console", default="127.0.0.1:8321", help="address of the console")
    long.add_argument("--port", type=int, default=8765, help="port of the bridge to Foxglove")
    fast = what.add_parser("chain")
    fast.add_argument("--seconds", type=float, default=30.0, help="of each repeat")
    fast.add_argument("--rounds", type=int, default=5, help="repeats of each")
    options = parser.parse_args()
    command = {"tune": tune, "monitor": monitor, "protocols": protocols, "demo": demo,
               "harm": measure_harm.harm, "peers": measure_peers.peers,
               "soak": measure_soak.soak, "chain": measure_chain.chain}
    with contextlib.ExitStack() as stack:
        folder = options.keep or stack.enter_context(tempfile.TemporaryDirectory())
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
        command[options.what](Rig(options.program, pathlib.Path(folder).resolve()), options)


if __name__ == "__main__":
    main()

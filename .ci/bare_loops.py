"""Bare loops that do nothing but wake, one on each processor: what the host takes from everybody.

cyclictest (Debian's rt-tests) where it is installed, else the loop on farreach's own grid:
`cargo build --release -p runtime --example grid_loop`.
"""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
GRID_LOOP = ROOT / "target/release/examples/grid_loop"
# Above every loop of a rig (85 at most): what is late here is the computer's own.
PRIORITY = 95
LONGEST_S = 86400
QUANTILES = (0.5, 0.99, 0.999)
# So many bins has cyclictest's histogram: of 1 ns, or of 1 µs without SCHED_FIFO, where wakes are
# later. Of those beyond it knows how many they are, and the latest.
BINS = 1_000_000


def cyclictest():
    """The program, or None."""
    return shutil.which("cyclictest")


def need_grid_loop():
    """Ends the measurement, with what to do, where the loop on the grid has not been built."""
    if not GRID_LOOP.exists():
        raise RuntimeError(f"{GRID_LOOP} is missing: "
                           "cargo build --release -p runtime --example grid_loop")


class Loop:
    """A bare loop on one processor, within a `with`; then `late_us` has p50, p99, p99.9, max, and
    `skipped` the periods that it skipped, where farreach's own loop ran."""

    def __init__(self, processor, rate_hz, *, peer, fifo=True, priority=PRIORITY):
        self.late_us, self.wakes, self.skipped, self.peer = [], 0, None, peer
        if peer:
            self.report = pathlib.Path(tempfile.mkstemp(suffix=".json")[1])
            policy = ["--policy=fifo", f"--priority={priority}"] if fifo else ["--policy=other"]
            self.unit_us = 1e-3 if fifo else 1.0
            command = [
                cyclictest(), "--quiet", "--mlockall", "--threads=1", f"--affinity={processor}",
                *policy, f"--interval={1_000_000 // rate_hz}", f"--duration={LONGEST_S}",
                *(["--nsecs"] if fifo else []), f"--histogram={BINS}", f"--json={self.report}",
            ]
            output = subprocess.DEVNULL
        else:
            need_grid_loop()
            command = [GRID_LOOP, rate_hz, priority if fifo else 0, processor, LONGEST_S]
            output = subprocess.PIPE
        self.child = subprocess.Popen([str(word) for word in command], stdout=output,
                                      stderr=subprocess.PIPE, text=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.child.terminate()
        printed, said = self.child.communicate()
        if self.child.returncode != 0:
            raise RuntimeError(f"{self.child.args[0]}: {said.strip()}")
        if self.peer:
            self.read_cyclictest()
        else:
            told = json.loads(printed)
            self.late_us, self.wakes = [ns / 1e3 for ns in told["late_ns"]], told["wakes"]
            self.skipped = told["skipped"]

    def read_cyclictest(self):
        """p50, p99, p99.9 and max from its report."""
        report = self.report.read_text()
        self.report.unlink()
        try:
            thread, = json.loads(report)["thread"].values()
        except json.JSONDecodeError as error:  # an average of nothing is no number
            raise RuntimeError("cyclictest did not wake once: is the computer busy?") from error
        self.wakes = thread["cycles"]
        counted = sorted((int(late), count) for late, count in thread["histogram"].items())
        late = [quantile(counted, thread["cycles"], share, thread["max"]) for share in QUANTILES]
        self.late_us = [value * self.unit_us for value in (*late, thread["max"])]


def quantile(counted, total, share, latest):
    """The quantile of a histogram of (value, count); `latest` where it lies beyond the last bin."""
    left = share * total
    for value, count in counted:
        left -= count
        if left <= 0:
            return value
    return latest


class EveryProcessor:
    """Such a loop on every processor; then `late_us` has the worst of them, figure by figure."""

    def __init__(self, rate_hz=1000, *, fifo=True):
        self.name = "cyclictest" if cyclictest() else "bare loop"
        self.loops = [Loop(processor, rate_hz, peer=bool(cyclictest()), fifo=fifo)
                      for processor in sorted(os.sched_getaffinity(0))]
        self.late_us = []

    def __enter__(self):
        return self

    def __exit__(self, *told):
        for loop in self.loops:
            loop.__exit__(*told)
        self.late_us = [max(column) for column in zip(*(loop.late_us for loop in self.loops))]

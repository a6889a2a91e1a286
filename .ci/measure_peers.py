"""farreach beside other programs that do the same, in one run: part of measure.py.

Repeats alternate; where two processes or loops are compared they change processors from repeat to
repeat. A ratio is farreach's time over the peer's in the same repeat: median and quartiles. The
peers are built in tests/peers, a workspace of its own, and its Python library in a folder under
target; the first run needs the network.
"""

import argparse
import contextlib
import json
import math
import os
import pathlib
import random
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import venv

import bare_loops
import measure_recordings

ROOT = pathlib.Path(__file__).resolve().parent.parent
PEERS = ROOT / "tests/peers"
RELEASE = ROOT / "target/release"
PYTHON = ROOT / "target/peers-python"
SHARED_MEMORY = pathlib.Path("/dev/shm")
# As acquisition's.
PRIORITY = 80


# --- building, running, ratios


def cargo(*arguments):
    """Builds something in release, or ends the measurement."""
    subprocess.run(["cargo", *map(str, arguments)], check=True, cwd=ROOT)


def build_peers(options):
    """The programs of tests/peers, among those of the workspace."""
    less = ["--no-default-features"] if options.without_zenoh else []
    cargo("build", "--release", "--locked", "--manifest-path", PEERS / "Cargo.toml",
          "--target-dir", ROOT / "target", *less)


def python():
    """The interpreter that has MCAP's library."""
    program, wanted = PYTHON / "bin/python", PEERS / "requirements.txt"
    installed = PYTHON / "installed.txt"
    if not installed.exists() or installed.read_text() != wanted.read_text():
        venv.create(PYTHON, with_pip=True)
        subprocess.run([program, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                        "-r", wanted], check=True)
        installed.write_text(wanted.read_text())
    return program


def told(*command):
    """What a program printed as JSON."""
    words = [str(word) for word in command]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr.strip()[-500:]}")
    return json.loads(done.stdout.splitlines()[-1])


def spread(values, digits=2):
    """Median and quartiles."""
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive") \
        if len(values) > 1 else values * 3
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def ratio(own, peer):
    """Of two lists, repeat by repeat."""
    return spread([a / b if b else math.nan for a, b in zip(own, peer)])


def two_processors(repeat):
    """Two processors, swapped from repeat to repeat."""
    processors = sorted(os.sched_getaffinity(0))[:2]
    if len(processors) < 2:
        raise RuntimeError("two processors are needed")
    return processors if repeat % 2 == 0 else processors[::-1]


# --- transports


TRANSPORTS = {
    "farreach": "farreach's ports",
    "iceoryx2": "iceoryx2 alone, same settings",
    "datagrams": "Unix datagram sockets",
    "zenoh": "Zenoh on a Unix socket",
    "zenoh-shared": "Zenoh with its shared memory",
}


class Program:
    """A program of tests/peers that says `ready`, and at its end JSON; within a `with`."""

    def __init__(self, words, environment):
        self.words = [str(word) for word in words]
        self.child = subprocess.Popen(self.words, env=environment, stdout=subprocess.PIPE,
                                      stderr=subprocess.PIPE, text=True)
        self.found = None

    def __enter__(self):
        if self.child.stdout.readline().strip() != "ready":
            self.__exit__()
        return self

    def __exit__(self, *_):
        if self.child.returncode is not None:
            return
        self.child.terminate()
        printed, said = self.child.communicate()
        if self.child.returncode != 0:
            raise RuntimeError(f"{' '.join(self.words)}: {said.strip()}")
        self.found = json.loads(printed) if printed.strip() else None


def exchange(transport, processors, options):
    """One process publishes, another reads: what both found."""
    name = f"peers-{os.getpid()}"
    program = RELEASE / "transports"
    priority = PRIORITY if options.profile == "realtime" else 0
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        stack.callback(wipe, name)
        environment = dict(os.environ, FARREACH_PROFILE=options.profile, TMPDIR=folder)
        if transport == "farreach":
            stack.enter_context(Program([program, transport, "keep", name], environment))
        reader = stack.enter_context(Program(
            [program, transport, "read", name, processors[1], priority], environment))
        done = subprocess.run(
            [str(word) for word in (program, transport, "publish", name, processors[0], priority,
                                    options.seconds)],
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            check=False)
        if done.returncode != 0:
            raise RuntimeError(f"transports {transport} publish: {done.stderr.strip()}")
        reader.__exit__()
        return json.loads(done.stdout), reader.found


def wipe(name):
    """Removes what the transports leave in shared memory: a rig's folder, a library's file."""
    shutil.rmtree(SHARED_MEMORY / f"farreach-{os.getuid()}-{name}", ignore_errors=True)
    for file in SHARED_MEMORY.glob(f"{name}_*"):
        file.unlink(missing_ok=True)


def transports(options):
    """Publishing a sample at 2 kHz and reading the newest one, in two processes."""
    build_peers(options)
    found = {transport: [] for transport in TRANSPORTS
             if not (options.without_zenoh and transport.startswith("zenoh"))}
    for repeat in range(options.repeats):
        order = list(found)
        random.Random(repeat).shuffle(order)
        for transport in order:
            found[transport].append(exchange(transport, two_processors(repeat), options))
    print("\n| transport of a sample, 496 bytes | publish, p50, p99, max (µs) | read the newest "
          "| age when read, p50, p99 (µs) | processor time for each message: publisher, reader "
          "(µs) | empty, old reads | publish: ratio | read: ratio |\n"
          "|---|---|---|---|---|---|---|---|")
    took = {transport: [[side["took_ns"][0] for side in pair] for pair in pairs]
            for transport, pairs in found.items()}
    for transport, pairs in found.items():
        sides = list(zip(*pairs))
        times = [", ".join(microseconds(side["took_ns"][index] for side in ends)
                           for index in (0, 1, 3)) for ends in sides]
        age = ", ".join(microseconds(end["age_ns"][index] for end in sides[1])
                        for index in (0, 1))
        used = ", ".join(microseconds(end["processor_ns"] for end in ends) for ends in sides)
        late = ", ".join(str(sum(end[key] for end in sides[1])) for key in ("empty", "old"))
        ratios = ["1", "1"] if transport == "farreach" else [
            ratio([own[side] for own in took["farreach"]], [peer[side] for peer in took[transport]])
            for side in (0, 1)]
        print(f"| {TRANSPORTS[transport]} | {times[0]} | {times[1]} | {age} | {used} | {late} "
              f"| {ratios[0]} | {ratios[1]} |")
    clock = statistics.median(end["clock_ns"] for pair in found["farreach"] for end in pair)
    print(f"\nEach time has one reading of the clock in it: {clock:.0f} ns.")


def microseconds(values):
    """The median (µs, of ns)."""
    return f"{statistics.median(values) / 1e3:.2f}"


# --- wake


def wake(options):
    """The loop on farreach's grid and cyclictest, at the same time on two processors."""
    if not bare_loops.cyclictest():
        raise RuntimeError("cyclictest is missing: apt-get install rt-tests")
    cargo("build", "--release", "--locked", "-p", "runtime", "--example", "grid_loop")
    fifo = options.profile == "realtime"
    own, peer = [], []
    for repeat in range(2 * options.repeats):
        first, second = two_processors(repeat)
        loop = {"fifo": fifo, "priority": PRIORITY}
        with bare_loops.Loop(first, 2000, peer=False, **loop) as grid, \
                bare_loops.Loop(second, 2000, peer=True, **loop) as cyclictest:
            time.sleep(options.seconds)
        own.append(grid.late_us)
        peer.append(cyclictest.late_us)
    print("\n| lateness at 2 kHz (µs) | p50 | p99 | p99.9 | max |\n|---|---|---|---|---|")
    for name, all_of in (("farreach's grid", own), ("cyclictest", peer)):
        print(f"| {name} | " + " | ".join(spread(column, 1) for column in zip(*all_of)) + " |")
    # Each has been on both processors in two repeats that follow each other.
    pairs = range(0, len(own), 2)
    ratios = [[math.sqrt(own[at][figure] * own[at + 1][figure]
                         / (peer[at][figure] * peer[at + 1][figure])) for at in pairs]
              for figure in range(4)]
    print("| ratio | " + " | ".join(map(spread, ratios)) + " |")


# --- recordings


def recording(folder, options):
    """A recording as a rig's logger writes it."""
    cargo("build", "--release", "--locked", "-p", "recorder", "--example", "long_recording")
    file = folder / "source.mcap"
    subprocess.run([RELEASE / "examples/long_recording", file, str(options.record_s)], check=True)
    return file


def writing(options):
    """The same messages by the logger's writer, the crate alone and the library for Python."""
    build_peers(options)
    program, script = RELEASE / "recordings", PEERS / "recordings.py"
    writers = {
        "the logger's writer": [program, "write", "farreach"],
        "crate `mcap` alone, same settings": [program, "write", "mcap"],
        "Python's `mcap`": [python(), script, "write"],
    }
    found = {name: [] for name in writers}
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        folder = pathlib.Path(folder)
        source = recording(folder, options)
        for repeat in range(options.repeats):
            order = list(writers)
            random.Random(repeat).shuffle(order)
            for name in order:
                out = folder / "out.mcap"
                found[name].append(told(*writers[name], source, out))
                out.unlink()
    own, = [of for name, of in found.items() if name == "the logger's writer"]
    print("\n| writing | messages | messages/s | processor time (s) | MB | ratio of processor time "
          "| ratio of time |\n|---|---|---|---|---|---|---|")
    for name, of in found.items():
        rates = [one["messages"] / one["s"] for one in of]
        ratios = [ratio([one[key] for one in own], [one[key] for one in of])
                  for key in ("processor_s", "s")]
        print(f"| {name} | {of[0]['messages']} | {spread(rates, 0)} "
              f"| {spread([one['processor_s'] for one in of])} | {of[0]['bytes'] / 1e6:.1f} "
              f"| {' | '.join(ratios)} |")


def reading(options):
    """`rec info`, `verify` and `export` beside others' readers of the same file."""
    build_peers(options)
    cargo("build", "--release", "--locked", "-p", "farreach")
    farreach, program = options.program, RELEASE / "recordings"
    script = [python(), PEERS / "recordings.py"]
    jobs = {
        "`rec info`": {
            "farreach": [farreach, "rec", "info", "FILE"],
            "crate `mcap`, summary": [program, "summary", "FILE"],
            "Python's `mcap`, summary": [*script, "summary", "FILE"],
        },
        "`rec verify`": {
            "farreach": [farreach, "rec", "verify", "FILE"],
            "crate `mcap`, all messages with checksums": [program, "read", "FILE"],
            "Python's `mcap`, all messages with checksums": [*script, "read", "FILE"],
        },
        "`rec export --to csv --topic sample`": {
            "farreach": [farreach, "rec", "export", "FILE", "--to", "csv", "--topic", "sample",
                         "-o", "OUT"],
            "Python's `mcap-ros2-support` and `csv`": [*script, "table", "FILE", "OUT"],
        },
    }
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        folder = pathlib.Path(folder)
        file = recording(folder, options)
        size = file.stat().st_size / 1e6
        # Linux counts for a process what its parent had when it started it.
        least = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"\n{options.record_s} s, {size:.0f} MB, {os.cpu_count()} processors; whole "
              f"processes, start included. No memory below {least:.0f} MiB is seen.\n\n"
              "| of a recording | program | s | MiB | ratio of time |\n|---|---|---|---|---|")
        for job, programs in jobs.items():
            found = {name: [] for name in programs}
            for repeat in range(options.repeats + 1):
                for name, words in programs.items():
                    one = once(words, file, folder)
                    if repeat > 0:  # the first brings the file into memory
                        found[name].append(one)
            own = [seconds for seconds, _ in found["farreach"]]
            for name, of in found.items():
                seconds = [one for one, _ in of]
                memory = statistics.median(mebibytes for _, mebibytes in of)
                print(f"| {job} | {name} | {spread(seconds, 3)} | {memory:.0f} "
                      f"| {ratio(own, seconds)} |", flush=True)


def once(words, file, folder):
    """Seconds and MiB of one run of a program on a recording."""
    out, log = folder / "out.csv", folder / "stderr"
    line = [str({"FILE": file, "OUT": out}.get(word, word)) for word in words]
    code, seconds, memory = measure_recordings.run(line, log)
    out.unlink(missing_ok=True)
    if code not in (0, 3):
        raise RuntimeError(f"{' '.join(line)}: {log.read_text(errors='replace').strip()[-500:]}")
    return seconds, memory


# --- benches that have a peer of their own


RATIO = re.compile(r"^(?P<name>.+?)  .*?ratio (?P<ratio>[\d.]+) \(")
STEP = re.compile(r"^(?P<name>\S.*?)\s{2,}[\d.]+\s+(?P<ratio>[\d.]+) \([\d.]+ to [\d.]+\)")


def bench(package, name, pattern, title, *arguments):
    """Medians, over runs of a bench, of the ratios that it prints itself."""
    found = {}
    for _ in range(5):
        done = subprocess.run(
            ["cargo", "bench", "--quiet", "--locked", "-p", package, "--bench", name, *arguments],
            cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        for line in done.stdout.splitlines():
            if row := pattern.match(line):
                found.setdefault(row["name"].strip(), []).append(float(row["ratio"]))
    if not found:
        raise RuntimeError(f"cargo bench -p {package} --bench {name} printed no ratio")
    print(f"\n| {title} | ratio, median and quartiles of 5 runs |\n|---|---|")
    for case, ratios in found.items():
        print(f"| {case} | {spread(ratios)} |")


def plant(_):
    """The simulated plant beside the same scheme in C."""
    bench("plant", "c_reference", RATIO, "plant beside C")


def control(_):
    """A control step beside a plain one; the filter leaves out what criterion would add."""
    bench("control", "step", STEP, "control step beside plain feedback", "--", "nothing")


PARTS = {"transports": transports, "wake": wake, "writing": writing, "reading": reading,
         "plant": plant, "control": control}


def part(name):
    """A part's name, checked."""
    if name not in PARTS:
        raise argparse.ArgumentTypeError(f"expected one of {', '.join(PARTS)}, found {name}")
    return name


def add_arguments(parser):
    """The command line of `measure.py peers`."""
    parser.add_argument("parts", nargs="*", metavar="PART", type=part,
                        help=f"{', '.join(PARTS)}; all, if left out")
    parser.add_argument("--repeats", type=int, default=6)
    parser.add_argument("--seconds", type=int, default=10,
                        help="of each repeat of transports and wake")
    parser.add_argument("--record-s", type=int, default=120,
                        help="length of the recording that is written and read")
    parser.add_argument("--folder", type=pathlib.Path, help="where recordings are written")
    parser.add_argument("--without-zenoh", action="store_true",
                        help="leaves it out; it takes minutes to build")
    parser.add_argument("--profile", default="realtime", choices=("realtime", "best-effort"))


def peers(_, options):
    """All parts, or those that were named."""
    for name in options.parts or PARTS:
        print(f"\n{PARTS[name].__doc__}", flush=True)
        PARTS[name](options)
        sys.stdout.flush()

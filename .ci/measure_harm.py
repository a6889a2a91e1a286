"""Whether those who look at a rig disturb it: part of measure.py.

Arms, by turns in every round, twice without anybody who looks: probes that print every message of
`sample`, one that is killed by SIGKILL again and again, one that is stopped by SIGSTOP, one whose
reader is slow. In each arm the handle moves, the loops' own messages are recorded, and a bare loop
runs beside on every processor.
"""

import bisect
import contextlib
import json
import math
import os
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import bare_loops

NOBODY = "nobody"
ARMS = {
    "1 probe": ["reads"],
    "4 probes": ["reads"] * 4,
    "8 probes": ["reads"] * 8,
    "killed again and again": ["killed"],
    "stopped": ["stopped"],
    "slow reader": ["slow"],
}
# Process, topic, the time at which its cycle decides, and the number of that cycle.
LOOPS = {
    "acquisition": ("sample", "gate_ns", "gate_cycles"),
    "control": ("command", "computed_ns", "sequence"),
    "watchdog": ("token", "issued_ns", "sequence"),
}
FIGURES = ("p50", "p99", "p99.9", "max")
COUNTERS = ("missed_periods", "lost", "undelivered", "dropped")
# Of the counts, those that are no loss of the rig's.
NO_LOSSES = ("samples", "s", "kills", "probes_s", "lost by the probes")
KILL_AFTER_S = 0.3
SLOW_BYTES, SLOW_EVERY_S = 4096, 0.1


# --- those who look


class Probe:
    """A `farreach probe echo sample`, and what becomes of it."""

    def __init__(self, rig, what):
        self.rig, self.what = rig, what
        self.over = threading.Event()
        self.processor_s, self.lost, self.kills = 0.0, 0, 0
        self.failed = None
        pipe = what in ("killed", "slow")
        self.child = self.start(subprocess.PIPE if pipe else subprocess.DEVNULL)
        self.thread = None
        if what == "stopped":
            self.thread = threading.Timer(1.0, self.child.send_signal, [signal.SIGSTOP])
        elif pipe:
            self.thread = threading.Thread(target=self.kill if what == "killed" else self.dawdle)
        if self.thread:
            self.thread.start()

    def start(self, output):
        return subprocess.Popen([self.rig.program, "probe", "echo", "sample"],
                                env=self.rig.environment, stdin=subprocess.DEVNULL,
                                stdout=output, stderr=subprocess.PIPE)

    def kill(self):
        """Kills it once it has printed, and starts the next."""
        while True:
            if not self.child.stdout.read1(65536):
                self.failed = self.failed or self.child.stderr.read().decode().strip()
            until = time.monotonic() + KILL_AFTER_S
            while time.monotonic() < until and self.child.stdout.read1(65536):
                pass
            self.child.kill()
            self.collect()
            self.kills += 1
            if self.over.is_set() or self.failed:
                return
            self.child = self.start(subprocess.PIPE)

    def dawdle(self):
        """Reads what it prints, much more slowly than it comes."""
        while not self.over.wait(SLOW_EVERY_S):
            self.child.stdout.read1(SLOW_BYTES)

    def collect(self):
        """Waits for its end; notes its processor time and the messages that it did not print."""
        if self.child.stdout:
            self.child.stdout.close()
        said = self.child.stderr.read().decode()
        self.child.stderr.close()
        _, status, usage = os.wait4(self.child.pid, 0)
        self.child.returncode = os.waitstatus_to_exitcode(status)
        self.processor_s += usage.ru_utime + usage.ru_stime
        self.lost += sum(int(count) for count in re.findall(r"(\d+) messages of sample are", said))
        return said.strip()

    def end(self):
        """Ends it in good order; the measurement fails where it had ended by itself."""
        self.over.set()
        if self.thread:
            self.thread.join()
        if self.what != "killed":
            by_itself = self.child.poll() is not None
            self.child.send_signal(signal.SIGTERM)
            self.child.send_signal(signal.SIGCONT)
            if self.what == "slow":
                # What it still holds is printed before it looks at the signal.
                while self.child.stdout.read1(65536):
                    pass
            if by_itself:
                self.failed = self.child.stderr.read().decode().strip() or "it ended by itself"
            self.collect()
        if self.failed:
            raise RuntimeError(f"farreach probe echo sample: {self.failed}")

    def abandon(self):
        """Ends it in any case, where the measurement failed."""
        self.over.set()
        if self.child.returncode is None:
            self.child.kill()


class Movement(threading.Thread):
    """Moves the handle for a time, and goes on where something trips the rig."""

    def __init__(self, rig, seconds):
        # Where the measurement fails, it does not wait for the rest of the time.
        super().__init__(daemon=True)
        self.rig, self.until, self.trips = rig, time.monotonic() + seconds, 0

    def run(self):
        while (left := self.until - time.monotonic()) > 5:
            duration = f"segments.0.duration_s={min(left, 60):.1f}"
            if self.rig.play("guided-1hz", "--set", duration).returncode != 0:
                self.trips += 1
                with contextlib.suppress(RuntimeError):
                    self.rig.arm()


# --- one arm


def measure(rig, arm, options):
    """Figures and counts of one arm."""
    file = rig.folder / "harm.mcap"
    seconds = options.minutes * 60
    fifo = options.profile == "realtime"
    with rig.up("--profile", options.profile, "--record", file):
        with bare_loops.EveryProcessor(fifo=fifo) as bare:
            begin, movement = time.monotonic_ns(), Movement(rig, seconds)
            movement.start()
            probes = []
            try:
                for what in ARMS.get(arm, []):
                    probes.append(Probe(rig, what))
                time.sleep(max(0.0, movement.until - time.monotonic()))
                for probe in probes:
                    probe.end()
            finally:
                for probe in probes:
                    probe.abandon()
            end = time.monotonic_ns()
        movement.join()
        # The loops tell their timing once a second.
        time.sleep(2.5)
    found = recorded(rig, file, begin, end)
    file.unlink()
    found["figures"] |= {f"bare {name}": us for name, us in zip(FIGURES, bare.late_us)}
    found["counts"] |= {
        "trips": movement.trips,
        "kills": sum(probe.kills for probe in probes),
        "lost by the probes": sum(probe.lost for probe in probes),
        "probes_s": sum(probe.processor_s for probe in probes),
        "s": (end - begin) / 1e9,
    }
    return found


def rows(rig, file, topic, *fields):
    """These fields of every message of a topic in a recording, as numbers."""
    words = [word for field in fields for word in ("--field", field)]
    command = [rig.program, "probe", "echo", topic, "--file", str(file), "--format", "csv", *words]
    with tempfile.TemporaryFile("w+") as said:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, env=rig.environment,
                              text=True) as child:
            next(child.stdout, None)  # the header
            yield from ([int(cell) for cell in line.split(",")[1:]] for line in child.stdout)
        # 3: something is missing in the recording, which is counted below
        if child.returncode not in (0, 3):
            said.seek(0)
            raise RuntimeError(f"{' '.join(command)}: {said.read().strip()}")


def recorded(rig, file, begin, end):
    """Figures (µs) and counts from what was recorded between two instants (ns)."""
    figures, counts = {}, dict.fromkeys(
        ("samples", "samples lost", "samples missed", "commands and tokens lost", "restarts"), 0)
    for process, (topic, decided, cycle) in LOOPS.items():
        timings = list(rows(rig, file, f"timing/{process}", "time_ns", "period_ns", "phase_ns",
                            "execution_ns[3]", *COUNTERS))
        for name, first, last in zip(COUNTERS, *(row[4:] for row in bounds(timings, begin, end))):
            counts[f"{process} {name}"] = last - first
        inside = [row[3] for row in timings if begin <= row[0] < end]
        figures[f"{process} longest cycle"] = max(inside, default=math.nan) / 1e3
        period, phase = timings[0][1:3]
        fields = [decided, cycle, "cycles_missed", "sequence", "incarnation"]
        fields += {"sample": ["tick"],
                   "command": ["sample_tick", "sample_time_ns", "time_ns"]}.get(topic, [])
        messages = [row for row in rows(rig, file, topic, *fields) if begin <= row[0] < end]
        late = lateness(messages, period, phase)
        figures |= {f"{process} {name}": us for name, us in zip(FIGURES, percentiles(late))}
        gaps = missing([row[3] for row in messages])
        counts["restarts"] += len({row[4] for row in messages}) - 1
        if topic == "sample":
            counts["samples"], counts["samples lost"] = len(messages), gaps
            # A sample that is lost takes its tick with it.
            counts["samples missed"] = max(0, missing([row[5] for row in messages]) - gaps)
        else:
            counts["commands and tokens lost"] += gaps
        if topic == "command":
            answers = first_answers(messages)
            figures["sample to command p99"] = percentiles(answers)[1]
    return {"figures": figures, "counts": counts}


def bounds(timings, begin, end):
    """The last message before the window and the first one after it, or what is nearest."""
    times = [row[0] for row in timings]
    first = max(0, bisect.bisect_right(times, begin) - 1)
    return timings[first], timings[min(len(times) - 1, bisect.bisect_left(times, end))]


def lateness(messages, period, phase):
    """How late each cycle decided, after the instant of its grid, skipped periods included (ns)."""
    late, before = [], None
    for decided, cycle, missed, *_ in messages:
        if before and before[0] == cycle:
            continue  # several scans of one cycle
        skipped = max(0, missed - before[1]) if before else 0
        late.append((decided - phase) % period + skipped * period)
        before = cycle, missed
    return late


def missing(numbers):
    """How many numbers are missing in a rising sequence; a new beginning is no gap."""
    return sum(max(0, b - a - 1) for a, b in zip(numbers, numbers[1:]))


def first_answers(commands):
    """From a scan to the first command that was computed from it (ns)."""
    taken, before = [], None
    for *_, tick, sampled, published in commands:
        if sampled and tick != before:
            taken.append(published - sampled)
        before = tick
    return taken


def percentiles(values):
    """p50, p99, p99.9 and max (µs, of ns)."""
    if not values:
        return [math.nan] * 4
    values = sorted(values)
    at = [math.ceil(share * len(values)) - 1 for share in (0.5, 0.99, 0.999, 1.0)]
    return [values[index] / 1e3 for index in at]


# --- the verdict


def false_alarm(arm, alone):
    """Chance that `beyond` holds of an arm that differs in nothing, with so many repeats."""
    above = arm - (arm - 1) // 2
    return math.comb(arm, above) / math.comb(arm + alone, above)


def beyond(arm, alone):
    """Whether the arm's median is above all repeats without probes; of two medians the lower."""
    return statistics.median_low(arm) > max(alone)


def verdict(found, totals, arm):
    """In words: what of an arm is beyond what the host does to the rig alone."""
    higher = [
        f"{name} {statistics.median_low(values):.0f} µs, above {max(found[NOBODY][name]):.0f}"
        for name, values in found[arm].items() if beyond(values, found[NOBODY][name])
    ]
    new = [f"{name}: {totals[arm][name]}, with nobody none" for name in totals[arm]
           if name not in NO_LOSSES and totals[arm][name] and not totals[NOBODY][name]]
    if not higher and not new:
        return "within the host's own spread"
    host = any(text.startswith("bare") for text in higher)
    also = " (the bare loop as well: the host was busier)" if host else ""
    return f"above the host's own spread{also}: {'; '.join(higher + new)}"


def cell(columns, *, spread):
    """Figures of a loop: medians over the repeats, or least and greatest."""
    if spread:
        return ", ".join(f"{min(values):.0f}–{max(values):.0f}" for values in columns)
    return ", ".join(f"{statistics.median(values):.0f}" for values in columns)


def tables(results, options):
    """The tables as Markdown."""
    found = {arm: {name: [repeat["figures"][name] for repeat in repeats]
                   for name in repeats[0]["figures"]} for arm, repeats in results.items()}
    bare = "cyclictest" if bare_loops.cyclictest() else "bare loop"
    processes = [*LOOPS, "bare"]
    yield (f"Profile {options.profile}, {options.rounds} rounds of {options.minutes:g} minutes for "
           "each arm. Lateness: p50, p99, p99.9, max (µs), median of the repeats.\n")
    yield ("| who looks | repeats | acquisition | control | watchdog | sample to command, p99 "
           f"| longest cycle of acquisition | {bare} |\n|---|---|---|---|---|---|---|---|")
    for arm, columns in found.items():
        for spread in (False, True) if arm == NOBODY else (False,):
            late = {process: cell([columns[f"{process} {name}"] for name in FIGURES],
                                  spread=spread) for process in processes}
            answer, longest = (cell([columns[name]], spread=spread) for name in
                               ("sample to command p99", "acquisition longest cycle"))
            who = f"{arm}: least and greatest" if spread else arm
            yield (f"| {who} | {len(results[arm])} | {late['acquisition']} | {late['control']} "
                   f"| {late['watchdog']} | {answer} | {longest} | {late['bare']} |")
    yield ("\n| who looks | s | samples | lost, missed | commands and tokens lost | periods "
           "skipped: acquisition, control, watchdog | not received by a loop | not delivered "
           "| trips, restarts | kills | probes: processors, messages not printed |\n"
           "|---|---|---|---|---|---|---|---|---|---|---|")
    totals = {arm: {name: sum(repeat["counts"][name] for repeat in repeats)
                    for name in repeats[0]["counts"]} for arm, repeats in results.items()}
    for arm, total in totals.items():
        each = {name: [total[f"{process} {name}"] for process in LOOPS] for name in COUNTERS}
        skipped = ", ".join(map(str, each["missed_periods"]))
        yield (f"| {arm} | {total['s']:.0f} | {total['samples']} | {total['samples lost']}, "
               f"{total['samples missed']} | {total['commands and tokens lost']} | {skipped} "
               f"| {sum(each['lost'])} | {sum(each['undelivered'])} "
               f"| {total['trips']}, {total['restarts']} | {total['kills']} "
               f"| {total['probes_s'] / total['s']:.2f}, "
               f"{total['lost by the probes']} |")
    alone = len(results[NOBODY])
    chance = false_alarm(options.rounds, alone)
    yield (f"\nA figure is above the host's own spread where its median over {options.rounds} "
           f"repeats is greater than all {alone} repeats with nobody who looks. Of an arm that "
           f"differs in nothing, each of {len(found[NOBODY])} figures would be so with a chance of "
           f"{100 * chance:.1f} %.\n")
    for arm in ARMS:
        yield f"- {arm}: {verdict(found, totals, arm)}."


def harm(rig, options):
    """Arms by turns, and what came out."""
    if not bare_loops.cyclictest():
        bare_loops.need_grid_loop()
    results = {arm: [] for arm in (NOBODY, *ARMS)}
    for number in range(options.rounds):
        order = [*ARMS, NOBODY, NOBODY]
        random.Random(number).shuffle(order)
        for arm in order:
            results[arm].append(measure(rig, arm, options))
            print(f"round {number + 1} of {options.rounds}: {arm}", file=sys.stderr, flush=True)
            (rig.folder / "harm.json").write_text(json.dumps(results, indent=1))
    for line in tables(results, options):
        print(line)

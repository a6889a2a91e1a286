"""How the chain from sample to command holds at higher rates, beside bare loops: part of
measure.py.

By turns in an order that is drawn anew for each round, and each with the computer to itself: a bare
loop on every processor, with the rate and the priority of acquisition; and a rig with these rates
that moves its handle and records, with the phases of its file and with measured ones. The bare
loops tell what the host takes from a loop that does nothing but wake.
"""

import itertools
import json
import os
import pathlib
import random
import re
import sys
import time

import bare_loops
from measure_harm import Movement, bounds, first_answers, percentiles, rows
from measure_peers import spread

ROOT = pathlib.Path(__file__).resolve().parent.parent
SHIPPED = ROOT / "launch/rigs/hydrostatic.toml"
# In the order in which they are printed: of acquisition and control, Hz. Phases are at least 20 µs
# apart within the shortest period; those of the first rates are the shipped ones.
RATES = {
    (2000, 500): None,
    (8000, 2000): {"simulator": 0, "acquisition": 45, "control": 75, "watchdog": 100,
                   "experiment": 24},
    (10000, 2000): {"simulator": 0, "acquisition": 40, "control": 60, "watchdog": 80,
                    "experiment": 20},
}
BARE = "bare loop"
RIGS = {"phases of the file": [], "phases measured": ["--phases", "measured"]}
PROCESSES = ("simulator", "acquisition", "control", "watchdog")
# As acquisition's.
PRIORITY = 80
# The loops tell their timing once a second.
TOLD_S = 2.5
PER = 1e6


def rig_file(rig, rates):
    """The shipped rig with other rates, and encoders that keep their zero."""
    file = rig.absolute(SHIPPED)
    text = file.read_text()
    # No loop that looks at commands may be slower than control.
    keys = {"acquisition_hz": rates[0], "control_hz": rates[1],
            "watchdog_hz": max(1000, rates[1])}
    for key, value in keys.items():
        text = replaced(rf"(?m)^{key} = \d+", f"{key} = {value}", text)
    if phases := RATES[rates]:
        section = "".join(f"{name} = {value}\n" for name, value in phases.items())
        text = replaced(r"(?m)^\[phases_us\]\n(?:\w+ = \d+\n)+", f"[phases_us]\n{section}", text)
    file.write_text(text)
    return file


def replaced(pattern, new, text):
    """The text with the one place that matches replaced."""
    text, found = re.subn(pattern, new, text)
    if found != 1:
        raise RuntimeError(f"{SHIPPED}: {pattern} matches {found} times, expected once")
    return text


def alone(rate, seconds):
    """Skipped periods of a million, and p50, p99, p99.9, max of lateness (µs), of the worst
    processor."""
    loops = [bare_loops.Loop(processor, rate, peer=False, priority=PRIORITY)
             for processor in sorted(os.sched_getaffinity(0))]
    time.sleep(seconds)
    for loop in loops:
        loop.__exit__()
    return {"skipped": max(PER * loop.skipped / (loop.wakes + loop.skipped) for loop in loops),
            "late": [max(column) for column in zip(*(loop.late_us for loop in loops))]}


def moving(rig, rates, options, seconds):
    """The same of each process of a rig, and the time from a sample to its command (µs)."""
    file = rig.folder / "chain.mcap"
    with rig.up("--rig", rig_file(rig, rates), "--profile", "realtime", "--record", file,
                *options, homes=False):
        begin, movement = time.monotonic_ns(), Movement(rig, seconds)
        movement.start()
        time.sleep(max(0.0, movement.until - time.monotonic()))
        end = time.monotonic_ns()
        movement.join()
        time.sleep(TOLD_S)
    found = {"trips": movement.trips}
    for process in PROCESSES:
        told = list(rows(rig, file, f"timing/{process}", "time_ns", "cycles", "missed_periods",
                         *(f"total_wake_late_ns[{at}]" for at in range(4)),
                         *(f"total_execution_ns[{at}]" for at in range(4))))
        first, last = bounds(told, begin, end)
        cycles, skipped = last[1] - first[1], last[2] - first[2]
        found[process] = {"skipped": PER * skipped / (cycles + skipped),
                          "late": [ns / 1e3 for ns in last[3:7]],
                          "takes": [ns / 1e3 for ns in last[7:11]]}
    commands = rows(rig, file, "command", "time_ns", "sample_tick", "sample_time_ns")
    answers = first_answers([(tick, sampled, published) for published, tick, sampled in commands
                             if begin <= published < end])
    found["answer"] = percentiles(answers)
    file.unlink()
    return found


def chain(rig, options):
    """Rounds of both, and the tables."""
    bare_loops.need_grid_loop()
    results = {rates: {what: [] for what in (BARE, *RIGS)} for rates in RATES}
    for number in range(options.rounds):
        order = [(rates, what) for rates in RATES for what in (BARE, *RIGS)]
        random.Random(number).shuffle(order)
        for rates, what in order:
            found = alone(rates[0], options.seconds) if what == BARE else \
                moving(rig, rates, RIGS[what], options.seconds)
            results[rates][what].append(found)
            print(f"round {number + 1} of {options.rounds}: {rates} {what}: {json.dumps(found)}",
                  file=sys.stderr, flush=True)
    for line in tables(results, options):
        print(line)


def tables(results, options):
    """The tables as Markdown."""
    yield (f"{options.rounds} rounds of {options.seconds} s for each. Median and quartiles over "
           "the rounds; ratios within a round.\n")
    yield ("| acquisition, control (Hz) | loop | periods skipped of a million | over the bare loop "
           "| late, p99 (µs) | late, p99.9 (µs) | a cycle takes, p99 (µs) |\n"
           "|---|---|---|---|---|---|---|")
    for rates, found in results.items():
        name, bare = f"{rates[0]}, {rates[1]}", found[BARE]
        yield (f"| {name} | {BARE} | {column(bare, 'skipped')} | 1 "
               f"| {column(bare, 'late', 1)} | {column(bare, 'late', 2)} | |")
        for what, process in itertools.product(RIGS, PROCESSES):
            own = [repeat[process] for repeat in found[what]]
            yield (f"| {name} | {process}, {what} | {column(own, 'skipped')} | {over(own, bare)} "
                   f"| {column(own, 'late', 1)} | {column(own, 'late', 2)} "
                   f"| {column(own, 'takes', 1)} |")
    yield ("\n| acquisition, control (Hz) | | sample to command: p50 (µs) | p99 (µs) | p99.9 (µs) "
           "| p99.9 less p50, over the bare loop's p99.9 | trips |\n|---|---|---|---|---|---|---|")
    for rates, what in itertools.product(results, RIGS):
        found = results[rates]
        answers = [repeat["answer"] for repeat in found[what]]
        late = [(answer[2] - answer[0]) / bare["late"][2]
                for answer, bare in zip(answers, found[BARE])]
        figures = " | ".join(spread([answer[at] for answer in answers], 0) for at in range(3))
        trips = sum(repeat["trips"] for repeat in found[what])
        yield f"| {rates[0]}, {rates[1]} | {what} | {figures} | {spread(late)} | {trips} |"


def column(repeats, name, at=None):
    """A figure over the rounds."""
    return spread([repeat[name] if at is None else repeat[name][at] for repeat in repeats], 0)


def over(own, bare):
    """Ratio of the skipped periods, round by round; in words where the bare loop skipped none."""
    if all(repeat["skipped"] for repeat in bare):
        return spread([a["skipped"] / b["skipped"] for a, b in zip(own, bare)])
    return "not told: the bare loop skipped none in a round"

#!/usr/bin/env python3
"""Runs recordings again (`farreach rec resim`) and fails where a command, a decision of the gate, a
token of the watchdog or a setpoint differs from what was recorded, or where there were too few
recordings. Ends with what was compared of each core, and what was not, by reason.

usage: .ci/resimulate.py FARREACH AT_LEAST FOLDER...
"""

import json
import pathlib
import re
import subprocess
import sys


def resimulate(program, path):
    """What `rec resim --json` found, or why it could not read the recording."""
    done = subprocess.run(
        [program, "rec", "resim", path, "--json"], capture_output=True, text=True, check=False
    )
    try:
        return json.loads(done.stdout), None
    except ValueError:
        return None, done.stderr.strip().splitlines()[0] if done.stderr else "no output"


def show_difference(core):
    """The first difference of a core, with what it was computed from."""
    first = core["first_difference"]
    print(f"    {core['core']}: {core['differing']} differ; first: {json.dumps(first)}")


def count(of_cores, core):
    """Adds what was compared of a core, and what was not, by reason."""
    counts = of_cores.setdefault(core["core"], {"compared": 0})
    counts["compared"] += core["compared"]
    for why, number in core["not_compared"].items():
        counts[why] = counts.get(why, 0) + number


def main():
    program, at_least, *folders = sys.argv[1:]
    paths = sorted(path for folder in folders for path in pathlib.Path(folder).rglob("*.mcap"))
    # The command reads all parts of a recording.
    paths = [path for path in paths if not re.search(r"\.part\d+$", path.stem)]
    compared_files, compared, left_out, trips, differing = 0, 0, 0, 0, 0
    of_cores = {}
    for path in paths:
        found, why = resimulate(program, path)
        name = "/".join(path.parts[-3:])
        if found is None:
            print(f"{name}: not run again: {why}")
            continue
        here = sum(core["compared"] for core in found["cores"])
        skipped = sum(sum(core["not_compared"].values()) for core in found["cores"])
        wrong = any(
            trip["recomputed"] not in (None, trip["recorded"]) for trip in found["trips"]
        )
        print(
            f"{name}: {here} compared, {skipped} not, {len(found['trips'])} trips"
            f"{'' if found['same'] and not wrong else ', NOT THE SAME'}"
        )
        for core in found["cores"]:
            count(of_cores, core)
            if core["differing"]:
                show_difference(core)
        differing += not found["same"] or wrong
        compared_files += here > 0
        compared += here
        left_out += skipped
        trips += len(found["trips"])
    print(
        f"{compared_files} recordings run again, {compared} messages compared, {left_out} not, "
        f"{trips} trips, {differing} recordings differ"
    )
    for name, counts in of_cores.items():
        print(f"{name}: {', '.join(f'{number} {what}' for what, number in counts.items())}")
    if differing:
        return 1
    if compared_files < int(at_least):
        print(f"expected at least {at_least} recordings, found {compared_files}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

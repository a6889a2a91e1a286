"""Measures time and peak memory of the commands of `farreach rec` on a long recording.

usage: measure_recordings.py FARREACH RECORDING [FOLDER]

RECORDING is written by `cargo run --release -p recorder --example long_recording FILE 3600`.
FOLDER takes what the commands write, and is emptied of it; it is the recording's, if left out.
Times are those of the second of two runs for what only reads, so that the file is in memory where
it fits there. The memory is the highest resident one (VmHWM) of the process.
"""

import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

COMMANDS = [
    ("info", ["info", "RUN"]),
    ("info --json", ["info", "RUN", "--json"]),
    ("verify", ["verify", "RUN"]),
    ("cat --topic command", ["cat", "RUN", "--topic", "command"]),
    ("export --to csv", ["export", "RUN", "--to", "csv", "-o", "OUT/record.csv"]),
    ("export --to csv --topic sample",
     ["export", "RUN", "--to", "csv", "--topic", "sample", "-o", "OUT/sample.csv"]),
    ("export --to parquet", ["export", "RUN", "--to", "parquet", "-o", "OUT/record.parquet"]),
    ("export --to parquet --topic sample",
     ["export", "RUN", "--to", "parquet", "--topic", "sample", "-o", "OUT/sample.parquet"]),
    ("export --to mat", ["export", "RUN", "--to", "mat", "-o", "OUT/S07_"]),
    ("export --to bids", ["export", "RUN", "--to", "bids", "-o", "OUT/study"]),
    ("cut, the middle half",
     ["cut", "RUN", "--from", "QUARTER", "--to", "THREE", "-o", "OUT/cut.mcap"]),
    ("recover", ["recover", "RUN", "-o", "OUT/recovered.mcap"]),
    ("merge with itself", ["merge", "RUN", "RUN", "-o", "OUT/merged.mcap"]),
]
READ_ONLY = {"info", "info --json", "verify", "cat --topic command"}


def run(command, log):
    """Exit code, seconds, and MiB of the highest resident memory."""
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        told = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(nowhere, 1)
        os.dup2(told, 2)
        os.execv(command[0], command)
    _, status, usage = os.wait4(child, 0)
    return os.waitstatus_to_exitcode(status), time.monotonic() - began, usage.ru_maxrss / 1024


def length_s(farreach, recording):
    """The length of a recording (s), as `info` says it."""
    with os.popen(f"'{farreach}' rec info '{recording}'") as told:
        lines = told.read().splitlines()
    return float(lines[1].split(", ")[1].split(" ")[0])


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    farreach, recording = (str(Path(word).resolve()) for word in sys.argv[1:3])
    folder = Path(sys.argv[3] if len(sys.argv) > 3 else Path(recording).parent)
    seconds = length_s(farreach, recording)
    words = {"RUN": recording, "QUARTER": str(seconds / 4), "THREE": str(seconds * 3 / 4)}
    size = Path(recording).stat().st_size / 1e9
    print(f"{Path(recording).name}: {seconds:.0f} s, {size:.2f} GB, {os.cpu_count()} processors\n")
    print(f"{'command':<34} {'s':>8} {'MiB':>8}  exit code")
    for name, command in COMMANDS:
        out = tempfile.mkdtemp(prefix="measured-", dir=folder)
        try:
            line = [words.get(word, word.replace("OUT", out)) for word in command]
            log = os.path.join(out, "stderr")
            for _ in range(2 if name in READ_ONLY else 1):
                code, taken, memory = run([farreach, "rec", *line], log)
            print(f"{name:<34} {taken:>8.2f} {memory:>8.1f}  {code}", flush=True)
            if code not in (0, 3):
                print(Path(log).read_text(encoding="utf-8", errors="replace"))
        finally:
            shutil.rmtree(out)


if __name__ == "__main__":
    main()

"""Compares a dataset of `farreach rec export --to bids` with its recording.

    check_bids.py DATASET RUN EXPECTED.jsonl

RUN names one run of the dataset, such as `sub-S07_task-forcematching_run-1`. EXPECTED has the
messages of the recording, as `farreach rec cat --json` prints them. Inputs and positions are
compared bit by bit for each sample, electrodes as `pyedflib` and `mne` read them within half a step
of their 24 bits, the onsets of segments to a nanosecond, and their annotations, which are counted
from the first sample, to half a period of the samples.
Exit code 1 and the first differences on stderr if anything differs.
"""

import csv
import gzip
import json
import sys
from pathlib import Path

import mne
import numpy
import pyedflib

SHOWN = 10
# Of 2 kHz: the first sample may have been taken late.
HALF_PERIOD = 0.25e-3
SEGMENT = {"segment started", "protocol resumed"}
NOT_FINITE = {"NaN": float("nan"), "inf": float("inf"), "-inf": float("-inf")}


class Check:
    def __init__(self):
        self.differences, self.values = [], 0

    def expect(self, where, wanted, found):
        self.values += 1
        if wanted != found and not (wanted != wanted and found != found):
            self.differences.append(f"{where}: expected {wanted!r}, found {found!r}")

    def near(self, where, wanted, found, tolerance):
        self.values += 1
        if not abs(wanted - found) <= tolerance:
            self.differences.append(f"{where}: expected {wanted!r}, found {found!r}")


def number(value):
    return NOT_FINITE[value] if isinstance(value, str) else float(value)


def cell(text):
    return float("nan") if text == "n/a" else float(text)


def table(path):
    opened = gzip.open(path, "rt") if path.suffix == ".gz" else open(path, encoding="utf-8")
    with opened as lines:
        return [line.rstrip("\n").split("\t") for line in lines]


def main(dataset, run, expected):
    check = Check()
    subject = Path(dataset) / run.split("_")[0]
    with_scan = (subject / "func").is_dir()
    behaviour = subject / ("func" if with_scan else "beh")
    messages = {}
    with open(expected, encoding="utf-8") as lines:
        for line in lines:
            message = json.loads(line)
            fields = message["fields"]
            if "text_len" in fields:
                fields["text"] = bytes(fields["text"][: fields["text_len"]]).decode()
                fields["kind"] = message["names"]["kind"]
            messages.setdefault(message["topic"], []).append(fields)
    samples = {sample["tick"]: sample for sample in messages["sample"]}
    events = messages["event/experiment"]

    about = json.loads((behaviour / f"{run}_recording-handle_physio.json").read_text())
    physio = table(behaviour / f"{run}_recording-handle_physio.tsv.gz")
    columns = about["Columns"]
    stem = run.replace("_run-", "_tracksys-encoders_run-")
    motion = table(subject / "motion" / f"{stem}_motion.tsv")
    positions = [row[0] for row in table(subject / "motion" / f"{stem}_channels.tsv")[1:]]
    check.expect("rows of positions", len(physio), len(motion))

    # The first row is the sample whose values stand in it: ticks follow each other from there.
    fields = {
        "handle_master": ("master_position", "master_present", 0),
        "handle_slave": ("slave_position", "slave_present", 0),
        "handle_torque": ("slave_torque", "torque_present", 0),
        "handle_motor": ("motor_v", "motor_present", 0),
        "trigger": ("analog_v", "analog_present", 7),
        **{f"emg_{at}": ("analog_v", "analog_present", at) for at in range(1, 7)},
        "scanner_trigger": ("analog_v", "analog_present", 7),
    }

    def value(sample, name):
        field, present, at = fields[name]
        return number(sample[field][at]) if sample[present] >> at & 1 else float("nan")

    at_torque = columns.index("handle_torque")

    def begins_at(tick):
        return all(
            tick + row in samples
            and value(samples[tick + row], name) == cell(motion[row][column])
            for row in range(min(100, len(motion)))
            for column, name in enumerate(positions)
        ) and value(samples[tick], "handle_torque") == cell(physio[0][at_torque])

    first = next(tick for tick in sorted(samples) if begins_at(tick))
    for row, cells in enumerate(physio):
        sample = samples.get(first + row)
        for name, text in zip(columns, cells):
            if name != "volume":
                wanted = value(sample, name) if sample else float("nan")
                check.expect(f"{name} of row {row}", wanted, cell(text))
        for name, text in zip(positions, motion[row]):
            wanted = value(sample, name) if sample else float("nan")
            check.expect(f"{name} of row {row}", wanted, cell(text))

    first_ns = samples[first]["scan_time_ns"]
    zero_ns = first_ns
    if with_scan:
        zero_ns = [volume for volume in messages["volume"] if volume["index"] == 0][0]["at_ns"]
    # The grid lies through the median of all scan times.
    check.near("StartTime", (first_ns - zero_ns) * 1e-9, about["StartTime"], HALF_PERIOD)

    segments = [event for event in events if event["kind"] in SEGMENT]
    with open(behaviour / f"{run}_events.tsv", encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines, delimiter="\t", quoting=csv.QUOTE_NONE))
    for event in segments:
        found = [row for row in rows if row["text"] == event["text"]]
        onset = (event["time_ns"] - zero_ns) * 1e-9
        check.expect(f"rows of {event['text']}", 1, len(found))
        tolerance = 2e-9 if with_scan else HALF_PERIOD
        check.near(f"onset of {event['text']}", onset, float(found[0]["onset"]), tolerance)

    bdf = str(subject / "emg" / f"{run}_emg.bdf")
    with pyedflib.EdfReader(bdf) as reader:
        labels = reader.getSignalLabels()
        limits = [reader.getPhysicalMaximum(at) for at in range(len(labels))]
        signals = {label: reader.readSignal(at) for at, label in enumerate(labels)}
        onsets, _, texts = reader.readAnnotations()
    mne.set_log_level("error")
    raw = mne.io.read_raw_bdf(bdf, preload=True, infer_types=False)
    in_volts = {"V": 1.0, "mV": 1e-3}
    with open(subject / "emg" / f"{run}_channels.tsv", encoding="utf-8") as lines:
        units = {row["name"]: row["units"] for row in csv.DictReader(lines, delimiter="\t")}
    check.expect("names of channels", list(units), labels)
    for label, limit in zip(labels, limits):
        ticks = range(first, first + len(physio))
        wanted = [value(samples[tick], label) if tick in samples else 0.0 for tick in ticks]
        wanted = numpy.nan_to_num(numpy.array(wanted))
        half = 0.5 * limit / 8388607 * (1 + 1e-6)
        for reader, found in (
            ("pyedflib", signals[label]),
            ("mne", raw.get_data(picks=[label])[0] / in_volts.get(units[label], 1.0)),
        ):
            check.values += len(wanted)
            worst = numpy.abs(found[: len(wanted)] - wanted).max()
            if not worst <= half:
                check.differences.append(f"{label} by {reader}: {worst} off, a half step is {half}")
    for event in segments:
        found = [at for at, text in zip(onsets, texts) if text.endswith(f": {event['text']}")]
        check.expect(f"annotations of {event['text']}", 1, len(found))
        onset = (event["time_ns"] - first_ns) * 1e-9
        check.near(f"annotation of {event['text']}", onset, found[0], HALF_PERIOD)
    check.expect("annotations by mne", len(texts), len(raw.annotations))

    for difference in check.differences[:SHOWN]:
        print(difference, file=sys.stderr)
    if check.differences:
        print(f"{len(check.differences)} differences", file=sys.stderr)
        sys.exit(1)
    print(f"BIDS: {len(physio)} samples, {len(rows)} events, {check.values} values, all equal")


if __name__ == "__main__":
    main(*sys.argv[1:])

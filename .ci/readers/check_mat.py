"""Compares a MATLAB file of `farreach rec export --to mat`, as scipy reads it, with its recording.

    check_mat.py FILE.mat EXPECTED.jsonl [--ascii]

The filtered electrodes are compared with those of scipy's filters, away from both ends.
EXPECTED has the messages of the recording, as `farreach rec cat --json` prints them. Time,
positions, torque, motor volts and every input of the card are compared bit by bit, for each sample.
`--ascii`: the file went through a program that keeps ASCII characters alone, such as Octave.
Exit code 1 and the first differences on stderr if anything differs.
"""

import json
import sys

import numpy
from scipy.io import loadmat
from scipy.signal import butter, iirnotch, sosfiltfilt, tf2sos

SHOWN = 10
NOT_FINITE = {"NaN": float("nan"), "inf": float("inf"), "-inf": float("-inf")}


def number(value):
    return NOT_FINITE[value] if isinstance(value, str) else float(value)


def equal(one, other):
    return one == other or one != one and other != other


def against_scipy(mat, names):
    """The filters of the rig file: 10 to 400 Hz, a notch at 50 Hz, an envelope of 5 Hz."""
    rate = 2000.0
    band = numpy.vstack([
        butter(4, 10.0, "highpass", fs=rate, output="sos"),
        butter(4, 400.0, "lowpass", fs=rate, output="sos"),
        tf2sos(*iirnotch(50.0, 30.0, fs=rate)),
    ])
    smooth = butter(2, 5.0, "lowpass", fs=rate, output="sos")
    for at, name in enumerate(mat["emg"].names):
        raw = mat["output"][:, names.index(str(name))]
        raw = numpy.where(numpy.isfinite(raw), raw, 0.0)
        filtered = sosfiltfilt(band, raw, padlen=1200)
        envelope = sosfiltfilt(smooth, numpy.abs(filtered), padlen=1200)
        middle = slice(len(raw) // 4, 3 * len(raw) // 4)
        for what, wanted in (("filtered", filtered), ("envelope", envelope)):
            found = getattr(mat["emg"], what)[middle, at]
            error = numpy.sqrt(numpy.nanmean((found - wanted[middle]) ** 2))
            yield f"{what} {name}", error / numpy.sqrt(numpy.mean(wanted[middle] ** 2))


def main(mat_file, expected, ascii_only=None):
    mat = loadmat(mat_file, squeeze_me=True, struct_as_record=False)
    samples = []
    with open(expected, encoding="utf-8") as lines:
        for line in lines:
            message = json.loads(line)
            if message["topic"] == "sample":
                samples.append(message["fields"])
    names = [str(name) for name in mat["names"]]
    units = [str(unit) for unit in mat["units"]]
    differences = []

    def expect(where, wanted, found):
        if not equal(wanted, found):
            differences.append(f"{where}: expected {wanted!r}, found {found!r}")

    expect("columns", len(names), mat["output"].shape[1])
    expect("rows", len(samples), mat["output"].shape[0])
    expect("unit of emg_1", "mV", units[names.index("emg_1")])
    text = str(mat["info"].rig_file)
    expect("the rig file's first line", True, text.startswith("# The hydrostatic"))
    if ascii_only is None:
        expect("unit of the torque", "N·m", units[names.index("handle_torque")])
        expect("a character that is not ASCII", True, "§" in text)
    begun = samples[0]["scan_time_ns"]
    fields = {
        "handle_master": ("master_position", 0, "master_present"),
        "handle_slave": ("slave_position", 0, "slave_present"),
        "handle_torque": ("slave_torque", 0, "torque_present"),
        "handle_motor": ("motor_v", 0, "motor_present"),
        **{f"emg_{at}": ("analog_v", at, "analog_present") for at in range(1, 7)},
        "scanner_trigger": ("analog_v", 7, "analog_present"),
    }
    expect("names", sorted(fields), sorted(names))
    for row, sample in enumerate(samples):
        expect(f"time of row {row}", (sample["scan_time_ns"] - begun) * 1e-9, mat["time"][row])
        for column, name in enumerate(names):
            field, at, present = fields[name]
            wanted = number(sample[field][at]) if sample[present] >> at & 1 else float("nan")
            expect(f"{name} of row {row}", wanted, mat["output"][row, column])
    for where, error in against_scipy(mat, names):
        expect(f"{where} by scipy's filters", True, error < 0.002)
    for difference in differences[:SHOWN]:
        print(difference, file=sys.stderr)
    if differences:
        print(f"{len(differences)} differences", file=sys.stderr)
        sys.exit(1)
    print(f"scipy: {len(samples)} samples of {len(names)} signals, all equal")


if __name__ == "__main__":
    main(*sys.argv[1:])

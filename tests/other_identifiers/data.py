"""Records, the split reported by farreach, and the filters common to all methods."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

TRANSMISSION = ("t_s", "motor_v", "master_rad", "slave_rad", "slave_torque_nm")


@dataclass
class Record:
    """One record of a transmission; `inputs` are volts and the hand's torque, `positions` master
    and slave (rad)."""

    name: str
    step_s: float
    inputs: np.ndarray
    positions: np.ndarray


def columns(path):
    """The columns of a CSV file by name."""
    with open(path, encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return dict(zip(names, table.T, strict=True))


def transmission(path):
    """A record of a transmission."""
    table = columns(path)
    missing = [name for name in TRANSMISSION if name not in table]
    if missing:
        raise SystemExit(
            f"{path}: expected the columns {', '.join(TRANSMISSION)}; missing:"
            f" {', '.join(missing)}"
        )
    time = table["t_s"]
    return Record(
        name=Path(path).name,
        step_s=float((time[-1] - time[0]) / (len(time) - 1)),
        inputs=np.column_stack([table["motor_v"], table["slave_torque_nm"]]),
        positions=np.column_stack([table["master_rad"], table["slave_rad"]]),
    )


def whole_records(identified, records):
    """Records by role, from farreach's JSON output."""
    by_name = {record.name: record for record in records}
    return {
        role: [by_name[Path(name).name] for name in names]
        for role, names in identified["records"].items()
    }


def blocks(identified, time):
    """Rows of one record by role, from farreach's labels `file[from..to s]`.

    A label is rounded to 0.01 s. A block here ends within half of that of farreach's: a row or two
    at 200 Hz and three at 610 Hz, of
    100 and more; there are guards of 0.1 s and more between blocks, so that no row changes its
    role.
    """
    found = {}
    for role, names in identified["records"].items():
        ranges = [re.search(r"\[([\d.]+)\.\.([\d.]+) s\]$", name) for name in names]
        if not all(ranges):
            raise SystemExit(
                f"records.{role}: expected labels like file.csv[0.10..0.70 s], found {names[:2]}"
            )
        found[role] = [
            (
                int(np.searchsorted(time, float(r[1]) - 1e-9)),
                int(np.searchsorted(time, float(r[2]) + 1e-9)),
            )
            for r in ranges
        ]
    return found


def low_pass(signal, cut_off_hz, step_s):
    """Zero-phase Butterworth filter of order 4, as farreach uses it for inverse models."""
    sections = butter(4, cut_off_hz, fs=1.0 / step_s, output="sos")
    pad = min(int(np.ceil(3.0 / (cut_off_hz * step_s))), len(signal) - 1)
    return sosfiltfilt(sections, signal, axis=0, padlen=pad)


def derivative(signal, step_s):
    """Central differences over five points, over fewer points at the ends."""
    slope = np.gradient(signal, step_s, axis=0)
    slope[2:-2] = (8.0 * (signal[3:-1] - signal[1:-3]) - (signal[4:] - signal[:-4])) / (
        12.0 * step_s
    )
    return slope


class Spectrum:
    """A band-limited signal: derivatives and values between the samples, by Fourier transform of
    its odd continuation."""

    def __init__(self, signal, step_s, continued=4096):
        self.continued, self.step_s, self.rows = continued, step_s, len(signal)
        before = 2.0 * signal[0] - signal[continued:0:-1]
        after = 2.0 * signal[-1] - signal[-2 : -continued - 2 : -1]
        whole = np.concatenate([before, signal, after])
        # The difference between the two ends is a straight line, which is subtracted before the
        # transform and added afterwards.
        self.slope = (whole[-1] - whole[0]) / (len(whole) - 1)
        self.first = whole[0]
        self.whole = len(whole)
        self.values = np.fft.rfft(whole - self.first - self.slope * np.arange(self.whole))

    def wave(self, order, cut_off_hz=None, finer=1):
        """The derivative of this order at `finer` values per sample, low-passed at the cut-off
        (cosine edge, 10 % wide)."""
        frequency = np.fft.rfftfreq(self.whole, self.step_s)
        weight = np.ones_like(frequency)
        if cut_off_hz is not None:
            edge = np.clip((frequency - 0.95 * cut_off_hz) / (0.1 * cut_off_hz), 0.0, 1.0)
            weight = 0.5 * (1.0 + np.cos(np.pi * edge))
        values = self.values * weight * (2j * np.pi * frequency) ** order
        wave = finer * np.fft.irfft(values, self.whole * finer)
        if order == 0:
            wave += self.first + self.slope * np.arange(len(wave)) / finer
        elif order == 1:
            wave += self.slope / self.step_s
        start = self.continued * finer
        return wave[start : start + (self.rows - 1) * finer + 1]


def rms(values):
    """Root mean square, by column."""
    return np.sqrt(np.mean(np.square(values), axis=0))

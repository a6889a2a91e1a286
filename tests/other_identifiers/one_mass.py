"""PySINDy and SysIdentPy on the two measured records: the force of EMPS, the simulated output of
Silverbox. The rows are those of farreach."""

import itertools
import time

import numpy as np

import data
import narmax
import sindy

# --- EMPS: from motion to force, all below 40 Hz, as in farreach and in the publication.

CUT_OFF_HZ = 40.0
# Every fifth sample from the hundredth on is a row, as in farreach.
STRIDE = 5
TURN_M = 0.0025
WIDTHS_M_S = (0.0005, 0.002, 0.01)
THRESHOLDS = (0.001, 0.003, 0.01, 0.03, 0.1)


class Emps:
    """The record, filtered, and its rows by role."""

    def __init__(self, path, identified):
        table = data.columns(path)
        time_s = table["t_s"]
        self.step_s = float((time_s[-1] - time_s[0]) / (len(time_s) - 1))
        self.position = data.low_pass(table["position_m"], CUT_OFF_HZ, self.step_s)
        self.velocity = data.derivative(self.position, self.step_s)
        self.acceleration = data.derivative(self.velocity, self.step_s)
        self.force = self.low_passed(table["force_n"])
        self.blocks = data.blocks(identified, time_s)

    def low_passed(self, signal):
        return data.low_pass(signal, CUT_OFF_HZ, self.step_s)

    def pieces(self, role, *signals):
        """Signals of a role, one array per block."""
        table = np.column_stack(signals)
        return [table[first:end] for first, end in self.blocks[role]]

    def percent(self, model_force, role):
        """Residual over the rows of a role, in percent of the root mean square of the force."""
        rows = np.concatenate([np.arange(first, end) for first, end in self.blocks[role]])
        rows = rows[rows % STRIDE == 0]
        residual = data.rms(self.force[rows] - model_force[rows])
        return float(100.0 * residual / data.rms(self.force[rows]))


def emps_force(emps, equations):
    """The force according to the equation of the speed; terms that are not linear in the motion
    pass the low-pass once more."""
    values = {"x": emps.position, "v": emps.velocity, "sin": np.sin, "cos": np.cos}
    values |= {"tanh": np.tanh, "sign": np.sign, "abs": np.abs}
    linear, bent, of_force = emps.acceleration.copy(), np.zeros_like(emps.force), 0.0
    for coefficient, term in zip(equations.coefficients[0], equations.terms, strict=True):
        if term == "force":
            of_force = coefficient
        elif term in ("1", "x", "v"):
            linear -= coefficient * eval(term, values)  # a term of the library above
        elif coefficient:
            bent -= coefficient * eval(term, values)
    if of_force == 0.0:
        return np.full_like(emps.force, np.nan)
    return (linear + emps.low_passed(bent)) / of_force


def emps_sindy(emps, tell):
    """PySINDy: acceleration from position, speed and force; solved for the force."""
    began, tried, single = time.perf_counter(), [], []
    states = emps.pieces("fit", emps.position, emps.velocity)
    inputs = emps.pieces("fit", emps.force)
    rates = emps.pieces("fit", emps.velocity, emps.acceleration)
    for degree, width, threshold in itertools.product((1, 2, 3), WIDTHS_M_S, THRESHOLDS):
        from_here = time.perf_counter()
        make = sindy.library(
            1, 1, 1, degree, width, control_products=False, per_turn=2.0 * np.pi / TURN_M
        )
        equations = sindy.fit(
            states, inputs, rates, emps.step_s, make, threshold, (["x", "v"], ["force"])
        )
        single.append(time.perf_counter() - from_here)
        error = emps.percent(emps_force(emps, equations), "select")
        settings = {"degree": degree, "width_m_s": width, "threshold": threshold}
        tell(f"sindy {settings}: {equations.count} terms, {error:.2f} %")
        tried.append((np.nan_to_num(error, nan=np.inf), len(tried), settings, equations))
    _, _, settings, equations = min(tried, key=lambda t: t[:2])
    return {
        "settings": settings | {"models_tried": len(tried)},
        "terms": equations.count,
        "model": equations.text(),
        "error": emps.percent(emps_force(emps, equations), "report"),
        "seconds": time.perf_counter() - began,
        "seconds_one_fit": float(np.median(single)),
    }


def emps_narmax(emps, tell, told=False):
    """SysIdentPy: the force as a polynomial of position, speed and acceleration at the same row;
    `told`: with the sign of the speed as a further input."""
    began, tried, single = time.perf_counter(), [], []
    for degree, width in itertools.product(
        (1, 2, 3) if told else (1, 3, 5), WIDTHS_M_S if told else (None,)
    ):
        signals, names = [emps.position, emps.velocity, emps.acceleration], [
            "force",
            "x",
            "v",
            "a",
        ]
        if told:
            signals.append(emps.low_passed(np.tanh(emps.velocity / width)))
            names.append(f"tanh(v / {width:g})")
        from_here = time.perf_counter()
        rows = [
            (f[::STRIDE, 0], x[::STRIDE])
            for f, x in zip(
                emps.pieces("fit", emps.force), emps.pieces("fit", *signals), strict=True
            )
        ]
        # Lag 1 of a signal shifted ahead by one row is the same row.
        ahead = [np.concatenate([x[1:], x[-1:]]) for _, x in rows]
        model = narmax.fit(
            [f for f, _ in rows],
            ahead,
            names,
            lags=(1, 1),
            degree=degree,
            most_terms=30,
            static=True,
        )
        single.append(time.perf_counter() - from_here)
        force = model.next([None, *[signal[:, None] for signal in signals]])
        error = emps.percent(force, "select")
        settings = {"degree": degree} | ({"width_m_s": width} if told else {})
        tell(f"narmax {settings}: {model.count} terms, {error:.2f} %")
        tried.append((error, len(tried), settings, model, force))
    _, _, settings, model, force = min(tried, key=lambda t: t[:2])
    return {
        "settings": settings | {"rate_hz": 200, "models_tried": len(tried)},
        "terms": model.count,
        "model": [model.text().replace("[k-1]", "[k]")],
        "error": emps.percent(force, "report"),
        "seconds": time.perf_counter() - began,
        "seconds_one_fit": float(np.median(single)),
    }


# --- Silverbox: simulation of the output from the input.

CUT_OFFS_HZ = (150.0, 200.0, 250.0)
# Steps of the simulation per sample of the input.
FINER = 8
# Samples simulated before a block of rows, from the measured state: ten times the memory of the
# system.
BEFORE = 300
NARX = ((0, (2, 2), 3), (1, (2, 2), 3), (0, (3, 3), 3), (1, (3, 3), 3), (1, (8, 8), 1))


class Silverbox:
    """The record and its rows by role."""

    # The simulation's steps per sample of the input, and the cut-off frequencies tried.
    finer, cut_offs_hz = FINER, CUT_OFFS_HZ

    def __init__(self, path, identified):
        table = data.columns(path)
        self.input, self.output = table["input"], table["output"]
        time_s = table["t_s"]
        self.step_s = float((time_s[-1] - time_s[0]) / (len(time_s) - 1))
        self.blocks = data.blocks(identified, time_s)

    def wave(self, signal, order, cut_off_hz=None, finer=1):
        """A signal's spectral derivative (see data.Spectrum)."""
        return data.Spectrum(signal, self.step_s).wave(order, cut_off_hz, finer)

    def layout(self, role):
        """Start of the simulation of each block of a role, and its number of samples."""
        first = np.array([max(first - BEFORE, 16) for first, _ in self.blocks[role]])
        steps = max(end - start for (_, end), start in zip(self.blocks[role], first, strict=True))
        return first, steps

    def simulate(self, equations, role, y, v):
        """Outputs (blocks, steps) from the input alone after the start of each block's run."""
        fine = self.wave(self.input, 0, finer=self.finer)
        first, steps = self.layout(role)
        state, shown = np.stack([y[first], v[first]]), np.empty((steps, len(first)))
        for k in range(steps):
            shown[k] = state[0]
            at = np.minimum((first + k) * self.finer, len(fine) - self.finer - 1)
            for j in range(self.finer):
                state = equations.step(
                    state, fine[None, at + j], fine[None, at + j + 1], self.step_s / self.finer, 1
                )
        return shown.T

    def millivolts(self, simulated, role):
        """Error of the simulated outputs (blocks, steps) on the rows of a role (mV)."""
        first, _ = self.layout(role)
        off = [
            self.output[a:b] - own[a - start : b - start]
            for (a, b), start, own in zip(self.blocks[role], first, simulated, strict=True)
        ]
        off = np.concatenate(off)
        return float(1e3 * data.rms(off)) if np.all(np.abs(off) < 10.0) else float("inf")


def silverbox_sindy(box, tell):
    """PySINDy: acceleration from output, its speed and input (spectral derivatives); simulated."""
    began, tried, single = time.perf_counter(), [], []

    def attempt(cut_off, degree, threshold):
        y, v, a = (box.wave(box.output, order, cut_off) for order in (0, 1, 2))
        u = box.wave(box.input, 0, cut_off)
        cut = [slice(first, end) for first, end in box.blocks["fit"]]
        from_here = time.perf_counter()
        equations = sindy.fit(
            [np.column_stack([y[c], v[c]]) for c in cut],
            [u[c, None] for c in cut],
            [np.column_stack([v[c], a[c]]) for c in cut],
            box.step_s,
            sindy.library(1, 1, 1, degree, float(0.1 * data.rms(v)), control_products=False),
            threshold,
            (["y", "v"], ["input"]),
        )
        single.append(time.perf_counter() - from_here)
        with np.errstate(all="ignore"):
            error = box.millivolts(box.simulate(equations, "select", y, v), "select")
        settings = {"cut_off_hz": cut_off, "degree": degree, "threshold": threshold}
        tell(f"sindy {settings}: {equations.count} terms, {error:.3f} mV")
        tried.append((error, len(tried), settings, equations, (y, v)))

    for threshold in (0.001, 0.003, 0.01, 0.03):
        attempt(box.cut_offs_hz[1], 3, threshold)
    best = min(tried, key=lambda t: t[:2])[2]
    for cut_off, degree in (
        (box.cut_offs_hz[0], 3),
        (box.cut_offs_hz[2], 3),
        (box.cut_offs_hz[1], 2),
        (box.cut_offs_hz[1], 5),
    ):
        attempt(cut_off, degree, best["threshold"])
    _, _, settings, equations, motion = min(tried, key=lambda t: t[:2])
    with np.errstate(all="ignore"):
        error = box.millivolts(box.simulate(equations, "report", *motion), "report")
    return {
        "settings": settings | {"models_tried": len(tried)},
        "terms": equations.count,
        "model": equations.text(),
        "error": error,
        "seconds": time.perf_counter() - began,
        "seconds_one_fit": float(np.median(single)),
    }


def silverbox_narmax(box, tell):
    """SysIdentPy: output from past outputs and inputs; simulated without measured outputs after the
    start."""
    began, tried, single = time.perf_counter(), [], []

    def simulate(model, role, ahead):
        first, steps = box.layout(role)
        back = np.arange(-model.lag, 0)
        y, shown = box.output[first[:, None] + back], np.empty((steps, len(first)))
        for k in range(steps):
            u = box.input[np.minimum(first[:, None] + back + k + ahead, len(box.input) - 1)]
            shown[k] = model.next([y, u])
            y = np.concatenate([y[:, 1:], shown[k][:, None]], axis=1)
        return shown.T

    for ahead, lags, degree in NARX:
        from_here = time.perf_counter()
        cut = box.blocks["fit"]
        model = narmax.fit(
            [box.output[a:b] for a, b in cut],
            [box.input[a + ahead : b + ahead, None] for a, b in cut],
            ["output", "input"],
            lags=lags,
            degree=degree,
            most_terms=40,
        )
        single.append(time.perf_counter() - from_here)
        with np.errstate(all="ignore"):
            error = box.millivolts(simulate(model, "select", ahead), "select")
        settings = {"input_ahead": ahead, "lags": lags, "degree": degree}
        tell(f"narmax {settings}: {model.count} terms, {error:.3f} mV")
        tried.append((error, len(tried), settings, model))
    _, _, settings, model = min(tried, key=lambda t: t[:2])
    with np.errstate(all="ignore"):
        error = box.millivolts(simulate(model, "report", settings["input_ahead"]), "report")
    return {
        "settings": settings | {"models_tried": len(tried)},
        "terms": model.count,
        "model": [model.text()],
        "error": error,
        "seconds": time.perf_counter() - began,
        "seconds_one_fit": float(np.median(single)),
    }

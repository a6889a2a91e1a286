"""PySINDy and SysIdentPy on the records of a transmission: fitted to the fit records, chosen on the
select records, evaluated on the report records.

Two errors that every model has, against measured positions:

- *ahead*: 12.5 ms (1/80 s) further with volts and hand torque as recorded and the model left to
itself; from every 12.5 ms of a record
  but the first 0.2 s. Models in state space know where they are by an observer, models with lags by
  the measured past.
- *free*: from rest at the first row to the end, 10 s.

And one that only models in state space have: the *innovation* under an observer of 150 rad/s, which
is what farreach states.
"""

import itertools
import time

import numpy as np

import data
import narmax
import sindy

AHEAD = 25
SETTLING = 400
SEEING_RAD_S = 150.0
OBSERVERS_RAD_S = (80.0, 150.0, 300.0)
# Records with which models are chosen.
CHOOSING_RAD_S = 150.0
OBSERVER_DAMPING = 1.4
# Number of rows averaged in one row of farreach's residual.
WIDTH = 8
# A model with a larger error counts as diverged (rad).
LOST_RAD = 1e3
# Runge-Kutta steps per row, as required by the steepest smoothed sign of the library (a pole at 300
# rad/s² over 0.05 rad/s, 0.25 ms).
STEPS = 2
STATES = (["qm", "qs", "vm", "vs"], ["volts", "torque"])

CUT_OFFS_HZ = (10.0, 20.0, 40.0, 80.0)
WIDTHS_RAD_S = (0.05, 0.3)
THRESHOLDS = (0.003, 0.01, 0.03, 0.1, 0.3)
DEGREES = (1, 2, 3)

# Rows per sample, lags of output and inputs, degree.
NARX = (
    (25, (4, 4), 1),
    (25, (4, 4), 2),
    (25, (2, 2), 3),
    (5, (8, 8), 1),
    (5, (16, 16), 1),
    (5, (4, 4), 2),
)
MOST_TERMS = 30


def errors(off):
    """Root mean square of master and slave (mrad); None if the model diverged."""
    off = (
        np.concatenate([part.reshape(-1, 2) for part in off])
        if isinstance(off, list)
        else off.reshape(-1, 2)
    )
    if not np.all(np.abs(off) < LOST_RAD):
        return None
    master, slave = (1e3 * data.rms(off)).tolist()
    return {"master": master, "slave": slave}


def score(error):
    """Criterion of choice: the mean logarithm of both errors."""
    return np.inf if error is None else float(np.mean(np.log([error["master"], error["slave"]])))


def stacked(records):
    """Positions and inputs of records as (records, rows, 2), cut to the shortest."""
    rows = min(len(record.positions) for record in records)
    return np.stack([r.positions[:rows] for r in records]), np.stack(
        [r.inputs[:rows] for r in records]
    )


# --- without a model


def constant_speed(records):
    """Prediction at the speed of the last 5, 12.5 or 25 ms: the reference that every model should
    improve on."""
    positions, _ = stacked(records)
    starts = np.arange(SETTLING, positions.shape[1] - AHEAD, AHEAD)
    found = []
    for back in (10, 25, 50):
        speed = (positions[:, starts] - positions[:, starts - back]) / back
        found.append(errors(positions[:, starts + AHEAD] - positions[:, starts] - AHEAD * speed))
    return min(found, key=score)


# --- PySINDy


def prepared(records, cut_off_hz):
    """Filtered positions, speeds, inputs and derivatives at 500 Hz, without both ends of a
    record."""
    states, inputs, rates = [], [], []
    for record in records:
        position = data.low_pass(record.positions, cut_off_hz, record.step_s)
        speed = data.derivative(position, record.step_s)
        acceleration = data.derivative(speed, record.step_s)
        rows = slice(SETTLING, -SETTLING, 4)
        states.append(np.hstack([position, speed])[rows])
        inputs.append(data.low_pass(record.inputs, cut_off_hz, record.step_s)[rows])
        rates.append(np.hstack([speed, acceleration])[rows])
    return states, inputs, rates


def observed(equations, positions, inputs, state, step_s, observer_rad_s):
    """Innovations (records, rows, 2) and states after each correction (rows, states, records)."""
    many, rows, _ = positions.shape
    gains = OBSERVER_DAMPING * observer_rad_s * step_s, observer_rad_s**2 * step_s
    innovations, states = np.empty((rows, 2, many)), np.empty((rows, 4, many))
    q, u = positions.transpose(1, 2, 0), inputs.transpose(1, 2, 0)
    for row in range(rows):
        off = q[row] - state[:2]
        innovations[row] = off
        state = state + np.concatenate([gains[0] * off, gains[1] * off])
        states[row] = state
        # Volts are held constant from row to row.
        state = equations.step(state, u[row], u[row], step_s, STEPS)
    return innovations.transpose(2, 0, 1), states


def walked(equations, record, rows, observer_rad_s):
    """As `observed`, from rest, on one record in plain numbers; an observer of bandwidth 0 corrects
    nothing. None if the model diverged."""
    rates, step_s = equations.rates_of_numbers, record.step_s
    h = step_s / STEPS
    gains = OBSERVER_DAMPING * observer_rad_s * step_s, observer_rad_s**2 * step_s
    q, u = record.positions[:rows].tolist(), record.inputs[:rows].tolist()
    innovations, states = np.empty((rows, 2)), np.empty((rows, 4))
    m, s, a, b = *q[0], 0.0, 0.0
    try:
        for row in range(rows):
            off_m, off_s = q[row][0] - m, q[row][1] - s
            if not (abs(off_m) < LOST_RAD and abs(off_s) < LOST_RAD):
                return None
            innovations[row] = off_m, off_s
            m, s = m + gains[0] * off_m, s + gains[0] * off_s
            a, b = a + gains[1] * off_m, b + gains[1] * off_s
            states[row] = m, s, a, b
            volts, torque = u[row]
            for _ in range(STEPS):
                a1, b1 = rates(m, s, a, b, volts, torque)
                a_, b_ = a + 0.5 * h * a1, b + 0.5 * h * b1
                a2, b2 = rates(m + 0.5 * h * a, s + 0.5 * h * b, a_, b_, volts, torque)
                c_, d_ = a + 0.5 * h * a2, b + 0.5 * h * b2
                a3, b3 = rates(m + 0.5 * h * a_, s + 0.5 * h * b_, c_, d_, volts, torque)
                e_, f_ = a + h * a3, b + h * b3
                a4, b4 = rates(m + h * c_, s + h * d_, e_, f_, volts, torque)
                m += h / 6.0 * (a + 2.0 * a_ + 2.0 * c_ + e_)
                s += h / 6.0 * (b + 2.0 * b_ + 2.0 * d_ + f_)
                a += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                b += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    except OverflowError:
        return None
    return innovations, states


def judged(equations, records, observer_rad_s):
    """Errors 12.5 ms ahead, and innovations averaged over 4 ms after the first 0.2 s, as farreach's
    residual."""
    q, u = stacked(records)
    starts = np.arange(SETTLING, q.shape[1] - AHEAD, AHEAD)
    walks = [walked(equations, record, q.shape[1], observer_rad_s) for record in records]
    if any(walk is None for walk in walks):
        return None, None
    innovations = np.stack([walk[0] for walk in walks])
    states = np.stack([walk[1] for walk in walks], axis=2)
    ahead = errors(foretold(equations, states, q, u, starts, records[0].step_s))
    return ahead, errors(averaged(innovations))


def foretold(equations, states, positions, inputs, starts, step_s):
    """Measured minus predicted (records, starts, 2)."""
    many = positions.shape[0]
    state = states[starts].transpose(1, 0, 2).reshape(4, -1)
    for k in range(AHEAD):
        u = inputs[:, starts + k].transpose(2, 1, 0).reshape(2, -1)
        state = equations.step(state, u, u, step_s, STEPS)
    shown = state[:2].reshape(2, len(starts), many).transpose(2, 1, 0)
    return positions[:, starts + AHEAD] - shown


def sections(records, cut_off_hz=40.0, rows=200, settling=75):
    """Simulates pieces of 0.1 s of the records together, with initial states from the filtered
    record; used for the choice only."""
    q, u, start = [], [], []
    for record in records:
        position = data.low_pass(record.positions, cut_off_hz, record.step_s)
        speed = data.derivative(position, record.step_s)
        for first in range(SETTLING, len(position) - rows - AHEAD, rows - settling):
            q.append(record.positions[first : first + rows + AHEAD])
            u.append(record.inputs[first : first + rows + AHEAD])
            start.append(np.concatenate([position[first], speed[first]]))
    return np.stack(q), np.stack(u), np.stack(start).T, np.arange(settling, rows, AHEAD)


def sindy_choice(fit_records, select_records, tell):
    """The best setting of the grid on the select records."""
    step_s = fit_records[0].step_s
    q, u, start, starts = sections(select_records)
    tried, single, laid_out = [], [], {}

    def attempt(cut_off, width, degree, threshold):
        if any(t[1:5] == (cut_off, width, degree, threshold) for t in tried):
            return
        began = time.perf_counter()
        make = sindy.library(2, 2, 2, degree, width, per_turn=1.0)
        if cut_off not in laid_out:
            laid_out[cut_off] = prepared(fit_records, cut_off)
        equations = sindy.fit(*laid_out[cut_off], 4 * step_s, make, threshold, STATES)
        single.append(time.perf_counter() - began)
        with np.errstate(all="ignore"):
            _, states = observed(
                equations, q[:, :-AHEAD], u[:, :-AHEAD], start, step_s, CHOOSING_RAD_S
            )
            error = errors(foretold(equations, states, q, u, starts, step_s))
        tried.append((score(error), cut_off, width, degree, threshold, equations))
        tell(
            f"sindy {cut_off:g} Hz, width {width:g}, degree {degree}, threshold {threshold:g}:"
            f" {equations.count} terms, {error}"
        )

    def best():
        return min(tried, key=lambda t: t[0])

    # First the smoothing, then the number of terms, then the shape of friction.
    for cut_off in CUT_OFFS_HZ:
        attempt(cut_off, WIDTHS_RAD_S[0], 2, 0.03)
    for degree, threshold in itertools.product(DEGREES, THRESHOLDS):
        attempt(best()[1], WIDTHS_RAD_S[0], degree, threshold)
    for width in WIDTHS_RAD_S[1:]:
        attempt(best()[1], width, best()[3], best()[4])
    for cut_off in CUT_OFFS_HZ:
        attempt(cut_off, best()[2], best()[3], best()[4])
    _, cut_off, width, degree, threshold, equations = best()
    settings = {
        "cut_off_hz": cut_off,
        "width_rad_s": width,
        "degree": degree,
        "threshold": threshold,
    }
    return equations, settings | {"models_tried": len(tried)}, float(np.median(single))


def run_sindy(roles, tell):
    """Chooses, fits and evaluates the model."""
    began = time.perf_counter()
    step_s = roles["fit"][0].step_s
    equations, settings, single = sindy_choice(roles["fit"], roles["select"], tell)
    with np.errstate(all="ignore"):
        q, u, start, starts = sections(roles["select"])
        chosen = []
        for observer in OBSERVERS_RAD_S:
            _, states = observed(equations, q[:, :-AHEAD], u[:, :-AHEAD], start, step_s, observer)
            chosen.append(
                (score(errors(foretold(equations, states, q, u, starts, step_s))), observer)
            )
        settings["observer_rad_s"] = min(chosen)[1]
        seconds = time.perf_counter() - began
        ahead, _ = judged(equations, roles["report"], settings["observer_rad_s"])
        _, seen = judged(equations, roles["report"], SEEING_RAD_S)
        rows = min(len(record.positions) for record in roles["report"])
        walks = [walked(equations, record, rows, 0.0) for record in roles["report"]]
        free = (
            None if any(walk is None for walk in walks) else errors([walk[0] for walk in walks])
        )
    return {
        "settings": settings,
        "terms": equations.count,
        "model": equations.text(),
        "ahead_mrad": ahead,
        "innovation_mrad": seen,
        "free_mrad": free,
        "seconds": seconds,
        "seconds_one_fit": single,
    }


def averaged(innovations):
    """Means over 4 ms after the first 0.2 s, as farreach's residual."""
    many, rows, _ = innovations.shape
    blocks = innovations[:, : rows // WIDTH * WIDTH].reshape(many, -1, WIDTH, 2).mean(axis=2)
    return blocks[:, SETTLING // WIDTH :]


# --- SysIdentPy


def sampled(records, every):
    """Samples of every n-th row: positions as they are, inputs as means since the last sample."""
    positions = [
        record.positions[: len(record.positions) // every * every : every] for record in records
    ]
    inputs = [
        record.inputs[: len(record.inputs) // every * every].reshape(-1, every, 2).mean(axis=1)
        for record in records
    ]
    return positions, inputs


class Pair:
    """Both positions, each with its own NARX model."""

    def __init__(self, records, every, lags, degree):
        self.every, self.lag = every, max(lags)
        positions, inputs = sampled(records, every)
        self.models = []
        for own, name in (
            (0, ["qm", "volts", "torque", "qs"]),
            (1, ["qs", "volts", "torque", "qm"]),
        ):
            outputs = [q[:, own] for q in positions]
            others = [
                np.column_stack([u, q[:, 1 - own]])
                for q, u in zip(positions, inputs, strict=True)
            ]
            self.models.append(
                narmax.fit(outputs, others, name, lags=lags, degree=degree, most_terms=MOST_TERMS)
            )

    def run(self, positions, inputs, starts, steps):
        """Predicted positions (starts, steps + 1, 2), the first one measured, from the sampled
        positions and inputs of one record."""
        back = np.arange(-self.lag + 1, 1)
        q = positions[starts[:, None] + back]
        u = inputs[starts[:, None] + back]
        shown = np.empty((len(starts), steps + 1, 2))
        shown[:, 0] = positions[starts]
        for k in range(steps):
            new = np.column_stack(
                [
                    model.next([q[..., own], u[..., 0], u[..., 1], q[..., 1 - own]])
                    for own, model in enumerate(self.models)
                ]
            )
            shown[:, k + 1] = new
            q = np.concatenate([q[:, 1:], new[:, None]], axis=1)
            following = np.minimum(starts + k + 1, len(inputs) - 1)
            u = np.concatenate([u[:, 1:], inputs[following][:, None]], axis=1)
        return shown

    def ahead(self, records):
        """Measured minus predicted, 12.5 ms ahead."""
        off = []
        for positions, inputs in zip(*sampled(records, self.every), strict=True):
            steps, rows = AHEAD // self.every, len(records[0].positions)
            starts = np.arange(SETTLING, rows - AHEAD, AHEAD) // self.every
            starts = starts[starts + steps < len(positions)]
            off.append(
                positions[starts + steps] - self.run(positions, inputs, starts, steps)[:, -1]
            )
        return off

    def free(self, records):
        """Measured minus simulated."""
        off = []
        for positions, inputs in zip(*sampled(records, self.every), strict=True):
            first = self.lag - 1
            steps = len(positions) - 1 - first
            off.append(
                positions[first:] - self.run(positions, inputs, np.array([first]), steps)[0]
            )
        return off


def run_narmax(roles, tell):
    """Chooses, fits and evaluates the model."""
    began = time.perf_counter()
    tried, single = [], []
    with np.errstate(all="ignore"):
        for every, lags, degree in NARX:
            from_here = time.perf_counter()
            pair = Pair(roles["fit"], every, lags, degree)
            single.append(time.perf_counter() - from_here)
            error = errors(pair.ahead(roles["select"]))
            tried.append((score(error), len(tried), pair))
            tell(
                f"narmax every {every}, lags {lags}, degree {degree}:"
                f" {[m.count for m in pair.models]} terms, {error}"
            )
        _, index, pair = min(tried, key=lambda t: t[:2])
        seconds = time.perf_counter() - began
        ahead, free = errors(pair.ahead(roles["report"])), errors(pair.free(roles["report"]))
    every, lags, degree = NARX[index]
    return {
        "settings": {
            "rate_hz": 2000 / every,
            "lags": lags,
            "degree": degree,
            "models_tried": len(NARX),
        },
        "terms": sum(model.count for model in pair.models),
        "model": [model.text() for model in pair.models],
        "ahead_mrad": ahead,
        "innovation_mrad": None,
        "free_mrad": free,
        "seconds": seconds,
        "seconds_one_fit": float(np.median(single)),
    }

"""A force from the motion at the same instant, on records of drives and elements: a hand fit,
PySINDy and SysIdentPy, on the filtered rows of farreach's equation error and in its roles."""

import itertools
import re
from pathlib import Path

import numpy as np
import pysindy as ps
from scipy.optimize import lsq_linear

import data
import narmax

# Highest cut-off (Hz) and largest share of the sampling frequency, as in farreach; rows per
# cut-off; filter settling at both ends, in periods of the cut-off.
CUT_OFFS = {"drive": (40.0, 0.1), "element": (100.0, 0.15)}
ROWS_PER_CUT_OFF, SETTLING = 5.0, 4.0
FORCES, POSITIONS = ("force_n", "torque_nm"), ("position_m", "position_rad")
# Where the sign of the speed is smoothed, in shares of its root mean square.
WIDTHS = (0.003, 0.02, 0.1, 0.3)
THRESHOLDS = (0.001, 0.003, 0.01, 0.03, 0.1)


class Record:
    """One file: filtered motion at the full rate, and the indices of its rows."""

    def __init__(self, path, kind):
        table = data.columns(path)
        self.name, self.time = Path(path).name, table["t_s"]
        self.force = next(table[name] for name in FORCES if name in table)
        position = next(table[name] for name in POSITIONS if name in table)
        self.step_s = float((self.time[-1] - self.time[0]) / (len(self.time) - 1))
        highest, share = CUT_OFFS[kind]
        self.cut_off_hz = min(highest, share / self.step_s)
        self.x = self.low_pass(position)
        self.v = data.derivative(self.x, self.step_s)
        self.a = np.zeros_like(self.x)
        x = self.x
        self.a[2:-2] = (16 * (x[1:-3] + x[3:-1]) - x[:-4] - x[4:] - 30 * x[2:-2]) / (
            12 * self.step_s**2
        )
        stride = max(int(1.0 / (self.step_s * ROWS_PER_CUT_OFF * self.cut_off_hz)), 1)
        settling = int(np.ceil(SETTLING / (self.step_s * self.cut_off_hz)))
        self.rows = np.arange(settling, len(x) - settling, stride)
        self.wanted = self.low_pass(self.force)

    def low_pass(self, signal):
        return data.low_pass(signal, self.cut_off_hz, self.step_s)

    def blocks(self, labels):
        """Rows of one role, block by block, from farreach's labels `file[from..to s]`."""
        found = []
        for label in labels:
            within = re.search(r"\[([\d.]+)\.\.([\d.]+) s\]$", label)
            first, last = (float(t) for t in within.groups())
            time = self.time[self.rows]
            found.append(self.rows[(time >= first - 1e-9) & (time <= last + 1e-9)])
        return found

    def own_blocks(self):
        """Rows by role where farreach gave no split: blocks of a fortieth, in turn two to fit, one
        to select, one to report, with its guards."""
        guard = int(np.ceil(SETTLING / (self.step_s * self.cut_off_hz)))
        found = {"fit": [], "select": [], "report": []}
        edges = np.linspace(self.rows[0], self.rows[-1] + 1, 41).astype(int)
        for k, (first, end) in enumerate(itertools.pairwise(edges)):
            inside = self.rows[(self.rows >= first) & (self.rows < end - guard)]
            found[("fit", "select", "fit", "report")[k % 4]].append(inside)
        return found


class Balance:
    """All records of a set, with their rows by role: role -> [(record, rows), ...]."""

    def __init__(self, paths, kind, identified, per_turn):
        self.records = [Record(path, kind) for path in paths]
        # Radians of the motor or joint per unit of position; None where nothing turns.
        self.per_turn = per_turn
        self.speed = data.rms(np.concatenate([r.v[r.rows] for r in self.records]))
        self.travel = np.ptp(np.concatenate([r.x[r.rows] for r in self.records]))
        self.roles = self.split(identified)

    def split(self, identified):
        roles = {"fit": [], "select": [], "report": []}
        if identified is None:
            if len(self.records) > 2:
                for k, record in enumerate(self.records):
                    of = ["fit", "select", "report"][max(k - len(self.records) + 3, 0)]
                    roles[of].append((record, record.rows))
                return roles
            for record in self.records:
                for role, blocks in record.own_blocks().items():
                    roles[role] += [(record, rows) for rows in blocks]
            return roles
        by_name = {record.name: record for record in self.records}
        for role, labels in identified["records"].items():
            for label in labels:
                name = Path(label.split("[")[0]).name
                record = by_name[name]
                blocks = record.blocks([label]) if "[" in label else [record.rows]
                roles[role] += [(record, rows) for rows in blocks]
        return roles

    def pieces(self, role, of):
        """A signal of each block of a role; `of` makes it, at the full rate, of a record."""
        made = {id(record): of(record) for record, _ in self.roles[role]}
        return [made[id(record)][rows] for record, rows in self.roles[role]]

    def force(self, role):
        return self.pieces(role, lambda record: record.wanted)

    def percent(self, model, role):
        """Error of the force in percent of its root mean square; `model` are the role's blocks."""
        wanted = np.concatenate(self.force(role))
        return float(100.0 * data.rms(wanted - np.concatenate(model)) / data.rms(wanted))

    def choice(self, models):
        """Held-back error of the model with the least error on the selecting rows; of each model
        its description and a function from role to blocks of force."""
        scored = [
            (np.nan_to_num(self.percent(model("select"), "select"), nan=np.inf), k)
            for k, (_, model) in enumerate(models)
        ]
        told, model = models[min(scored)[1]]
        return self.percent(model("report"), "report"), told


# --- the hand fit


def dahl(x, travel):
    """Friction that builds up over a travel after each reversal, between -1 and 1."""
    state, shown = 0.0, np.zeros_like(x)
    for k, step in enumerate(np.diff(x, prepend=x[0])):
        if step != 0.0:
            side = np.sign(step)
            state = side + (state - side) * np.exp(-abs(step) / travel)
        shown[k] = state
    return shown


def columns(balance, effect, width):
    """Columns of an effect at the full rate, as functions of a record; `width` is its shape."""
    smooth = width * balance.speed
    if effect == "coulomb":
        return [lambda r: r.low_pass(np.tanh(r.v / smooth))]
    if effect == "asymmetric":
        return [lambda r: r.low_pass(np.abs(r.v))]
    if effect == "spring":
        return [lambda r: r.x]
    if effect == "mass":
        return [lambda r: r.a]
    if effect == "gravity":
        return [lambda r: r.low_pass(np.sin(r.x)), lambda r: r.low_pass(np.cos(r.x))]
    if effect == "dahl":
        return [lambda r: r.low_pass(dahl(r.x, width * balance.travel))]
    order = int(effect.removeprefix("ripple "))
    return [
        lambda r: r.low_pass(np.sin(order * r.x)),
        lambda r: r.low_pass(np.cos(order * r.x)),
    ]


def hand(balance, kind, bounds, effects):
    """Least squares of the declared terms, within their tolerances, and of the effects."""
    declared = [
        (lambda r: r.a) if kind == "drive" else (lambda r: r.x),
        lambda r: r.v,
        lambda r: np.ones_like(r.x),
    ]
    models = []
    for width in WIDTHS if {"coulomb", "dahl"} & set(effects) else WIDTHS[:1]:
        made = declared + [c for effect in effects for c in columns(balance, effect, width)]
        table = {}
        for role in balance.roles:
            signals = [balance.pieces(role, column) for column in made]
            table[role] = [np.column_stack(parts) for parts in zip(*signals, strict=True)]
        fit = np.vstack(table["fit"])
        scale = data.rms(fit) + 1e-300
        low, high = np.full(len(made), -np.inf), np.full(len(made), np.inf)
        low[:3], high[:3] = np.array(bounds).T * scale[:3]
        solved = lsq_linear(fit / scale, np.concatenate(balance.force("fit")), (low, high))
        found = solved.x / scale
        models.append((width, lambda role, t=table, f=found: [part @ f for part in t[role]]))
    return balance.choice(models)[0]


# --- PySINDy


def waves(angle):
    """Sine and cosine of the position times `angle`: functions of one argument, because PySINDy
    counts them."""
    return ps.CustomLibrary(
        [lambda x: np.sin(angle * x), lambda x: np.cos(angle * x)],
        [lambda x: f"sin({angle:g} {x})", lambda x: f"cos({angle:g} {x})"],
    )


def library(degree, width, orders, per_turn):
    """Of position, speed and acceleration: polynomials of the first two, friction of the usual
    forms, waves of the angle up to an order, and the acceleration."""
    made = [
        ps.PolynomialLibrary(degree=degree),
        ps.CustomLibrary(
            [lambda v: np.sign(v), lambda v: np.tanh(v / width), lambda v: np.abs(v) * v],
            [lambda v: f"sign({v})", lambda v: f"tanh({v}/{width:g})", lambda v: f"|{v}| {v}"],
        ),
        ps.CustomLibrary([lambda a: a], [lambda a: a]),
    ]
    inputs = [[0, 1], [1], [2]]
    for order in range(1, orders + 1):
        made.append(waves(order * per_turn))
        inputs.append([0])
    return ps.GeneralizedLibrary(made, inputs_per_library=inputs)


def pysindy(balance):
    """STLSQ of the force over the library, whose columns pass the low-pass as the force does."""
    models = []
    wanted = np.concatenate(balance.force("fit"))
    size = data.rms(wanted)
    orders = (0,) if balance.per_turn is None else (1, 8)
    for degree, width, most in itertools.product((1, 2, 3), WIDTHS[:3], orders):
        terms = library(degree, width * balance.speed, most, balance.per_turn)
        table = {}
        for record in balance.records:
            motion = np.column_stack([record.x, record.v, record.a])
            terms.fit(motion)
            table[id(record)] = record.low_pass(np.asarray(terms.transform(motion)))
        table = {
            role: balance.pieces(role, lambda record, t=table: t[id(record)])
            for role in balance.roles
        }
        fit = np.vstack(table["fit"])
        for threshold in THRESHOLDS:
            solver = ps.STLSQ(
                threshold=threshold * np.sqrt(len(fit)),
                alpha=1e-6,
                max_iter=20,
                normalize_columns=True,
            )
            solver.fit(fit, wanted[:, None] / size)
            found = np.ravel(solver.coef_) * size
            count = int(np.count_nonzero(found))
            models.append(
                (count, lambda role, t=table, f=found: [np.asarray(p @ f) for p in t[role]])
            )
    return balance.choice(models)


# --- SysIdentPy


def sysidentpy(balance):
    """The force as a polynomial of position, speed and acceleration at the same row; and the same
    told of the smoothed sign of the speed."""
    models = []
    tries = [(degree, None) for degree in (1, 3, 5)]
    tries += [(degree, width) for degree in (1, 2, 3) for width in WIDTHS[:3]]
    # Of one size, because a polynomial's products would differ by many decades.
    sizes = [data.rms(np.concatenate([getattr(r, s) for r in balance.records])) for s in "xva"]
    for degree, width in tries:

        def signals(record, width=width):
            made = [getattr(record, s) / size for s, size in zip("xva", sizes, strict=True)]
            if width is not None:
                made.append(record.low_pass(np.tanh(record.v / (width * balance.speed))))
            return np.column_stack(made)

        rows = balance.pieces("fit", signals)
        names = ["force", "x", "v", "a", "sign(v)"][: rows[0].shape[1] + 1]
        # Lag 1 of a signal shifted ahead by one row is the same row.
        ahead = [np.concatenate([part[1:], part[-1:]]) for part in rows]
        model = narmax.fit(
            balance.force("fit"),
            ahead,
            names,
            lags=(1, 1),
            degree=degree,
            most_terms=30,
            static=True,
        )

        def force(role, model=model, signals=signals):
            return [
                np.broadcast_to(model.next([None, *part.T[:, :, None]]), len(part))
                for part in balance.pieces(role, signals)
            ]

        models.append((model.count, force))
    return balance.choice(models)

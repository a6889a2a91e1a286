"""PySINDy: sparse regression on the records, and its result as a model that can be simulated.

States are positions and speeds, inputs are controls. The library has polynomials of states and
controls, and for each speed a sign, a
smoothed sign `tanh(v/width)` and `|v| v`, for each position a sine and a cosine: friction of all
usual forms, gravity and ripple are within its
reach. Targets are scaled to a root mean square of 1 and columns normalised, so that STLSQ's
threshold is the share of the
target's root mean square that a term must carry to be kept; width, threshold, degree and cut-off
are chosen on the selecting records.
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np
import pysindy as ps


@dataclass
class Equations:
    """Derivatives of the speeds as sums of terms: per equation a list of (coefficient, term of the
    library)."""

    states: list
    inputs: list
    terms: list
    # For each speed: the coefficient of each term.
    coefficients: np.ndarray

    def __post_init__(self):
        """Compiles the sums to a function on arrays, for speed."""
        lines, used = [], []
        for index, term in enumerate(self.terms):
            if np.any(self.coefficients[:, index]):
                lines.append(f"    t{index} = {term}")
                used.append(index)
        sums = [
            " + ".join(f"({row[i]!r}) * t{i}" for i in used if row[i]) or "0.0"
            for row in self.coefficients.tolist()
        ]
        names = ", ".join([*self.states, *self.inputs])
        code = f"def rates({names}):\n" + "\n".join(
            [*lines, "    return " + ", ".join(sums) + ","]
        )
        space = {"sin": np.sin, "cos": np.cos, "tanh": np.tanh, "sign": np.sign, "abs": np.abs}
        exec(code, space)  # the generated text above only
        self.rates = space["rates"]
        # The same for plain numbers: ten times as fast for a single record.
        space = {"sin": math.sin, "cos": math.cos, "tanh": math.tanh, "sign": sign, "abs": abs}
        exec(code, space)
        self.rates_of_numbers = space["rates"]

    @property
    def count(self):
        """Number of terms in all equations."""
        return int(np.count_nonzero(self.coefficients))

    def text(self, most=12):
        """The equations as text, terms in the order of the library."""
        names = [f"d{speed}/dt" for speed in self.states[len(self.states) // 2 :]]
        shown = []
        for name, row in zip(names, self.coefficients, strict=True):
            kept = [(c, t) for c, t in zip(row, self.terms, strict=True) if c]
            more = f" + ... ({len(kept)} terms)" if len(kept) > most else ""
            shown.append(f"{name} = " + " + ".join(f"{c:.4g} {t}" for c, t in kept[:most]) + more)
        return shown

    def step(self, state, before, after, duration, steps):
        """One Runge-Kutta step of order 4; `state` has the shape (states, records), inputs are
        interpolated linearly from `before` to `after`."""
        h = duration / steps
        half = len(state) // 2

        def slope(x, u):
            speeds = self.rates(*x, *u)
            return np.concatenate([x[half:], np.broadcast_arrays(*speeds, x[0])[:-1]])

        for i in range(steps):
            u0 = before + (after - before) * (i / steps)
            u1 = before + (after - before) * ((i + 0.5) / steps)
            u2 = before + (after - before) * ((i + 1) / steps)
            k1 = slope(state, u0)
            k2 = slope(state + 0.5 * h * k1, u1)
            k3 = slope(state + 0.5 * h * k2, u1)
            k4 = slope(state + h * k3, u2)
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return state


def sign(number):
    """The sign of a number, 0 for 0."""
    return (number > 0.0) - (number < 0.0)


def library(positions, speeds, controls, degree, width, control_products=True, per_turn=None):
    """The library, with term names that are Python expressions; `per_turn` converts a position to
    the angle in sine and cosine."""
    n = positions + speeds + controls
    friction = ps.CustomLibrary(
        [lambda v: np.sign(v), lambda v: np.tanh(v / width), lambda v: np.abs(v) * v],
        [lambda v: f"sign({v})", lambda v: f"tanh({v} / {width:g})", lambda v: f"abs({v}) * {v}"],
    )
    polynomial = ps.PolynomialLibrary(degree=degree)
    libraries = [polynomial, friction]
    reach = [list(range(n)) if control_products else list(range(positions + speeds))]
    reach.append(list(range(positions, positions + speeds)))
    if per_turn is not None:
        place = ps.CustomLibrary(
            [lambda q: np.sin(per_turn * q), lambda q: np.cos(per_turn * q)],
            [lambda q: f"sin({per_turn:g} * {q})", lambda q: f"cos({per_turn:g} * {q})"],
        )
        libraries.append(place)
        reach.append(list(range(positions)))
    if not control_products:
        libraries.append(ps.IdentityLibrary())
        reach.append(list(range(positions + speeds, n)))
    return ps.GeneralizedLibrary(libraries, inputs_per_library=reach)


def fit(states, inputs, rates, step_s, make_library, threshold, names):
    """Fits the rates of the speeds. Lists of arrays, one a record or block; `names` are those of
    states and inputs.

    `rates` has the derivatives of all states; those of positions are the speeds, which is not left
    to the regression when simulated.
    """
    scale = np.sqrt(np.mean(np.square(np.concatenate(rates)), axis=0))
    scaled = [rate / scale for rate in rates]
    rows = sum(len(rate) for rate in rates)
    optimizer = ps.STLSQ(
        threshold=threshold * np.sqrt(rows), alpha=1e-6, max_iter=20, normalize_columns=True
    )
    model = ps.SINDy(optimizer=optimizer, feature_library=make_library)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(states, t=step_s, x_dot=scaled, u=inputs, feature_names=[*names[0], *names[1]])
    half = states[0].shape[1] // 2
    coefficients = model.coefficients() * scale[:, None]
    terms = [python(name) for name in model.get_feature_names()]
    return Equations(names[0], names[1], terms, np.asarray(coefficients[half:]))


def python(name):
    """Converts PySINDy's product notation `x y^2` to Python."""
    if "(" in name:
        return name
    return " * ".join(part.replace("^", "**") for part in name.split(" "))

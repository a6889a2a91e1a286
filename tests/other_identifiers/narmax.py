"""SysIdentPy: polynomial NARX models by forward regression (FROLS), their order by an information
criterion.

One model a measured position, each with the volts, the hand's torque and the other position as
inputs: SysIdentPy's models have one
output. To foretell, the two are stepped together, and neither sees a measured value after the
start.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares


class FrolsOfRecords(FROLS):
    """FROLS on concatenated records: rows whose lags reach into the previous record are left
    out.

    SysIdentPy takes one record; at a seam positions jump, and a few such rows outweigh thousands of
    good ones.
    """

    seams = ()
    path = None

    def run_mss_algorithm(self, psi, y, process_term_number):
        # Forward regression is nested: a short regression is the beginning of a longer one.
        # SysIdentPy repeats it for every order that the criterion examines; run once, it gives
        # the same models fifteen times as fast.
        longest = min(max(self.n_info_values, process_term_number), psi.shape[1])
        if self.path is None or self.path[0] < longest:
            keep = np.ones(len(psi), dtype=bool)
            for seam in self.seams:
                keep[seam - self.max_lag : seam] = False
            target = y[self.max_lag :][keep]
            # The algorithm itself omits the first `max_lag` rows of y.
            whole = np.concatenate([y[: self.max_lag], target])
            error, order, _ = self.error_reduction_ratio(psi[keep], whole, longest)
            self.path = longest, error, order, psi[keep][:, order], target
        _, error, order, chosen, target = self.path
        return error, order[:process_term_number], chosen[:, :process_term_number], target


@dataclass
class Narx:
    """A sum of products of lagged values: (coefficient, [(variable, lag), ...]); variable 0 is the
    output itself."""

    terms: list
    names: list
    lag: int

    @property
    def count(self):
        """Number of terms in the model."""
        return len(self.terms)

    def text(self, most=12):
        """The model as text, terms ordered by their share of the explained variance."""

        def product(factors):
            return (
                " ".join(f"{self.names[variable]}[k-{lag}]" for variable, lag in factors) or "1"
            )

        shown = " + ".join(f"{c:.4g} {product(factors)}" for c, factors in self.terms[:most])
        more = f" + ... ({self.count} terms)" if self.count > most else ""
        return f"{self.names[0]}[k] = {shown}{more}"

    def next(self, lagged):
        """The next value; `lagged[variable][..., -1]` is the latest value of each variable."""
        total = 0.0
        for coefficient, factors in self.terms:
            part = coefficient
            for variable, lag in factors:
                part = part * lagged[variable][..., -lag]
            total = total + part
        return total


def fit(outputs, inputs, names, *, lags, degree, most_terms, static=False):
    """Fits a model to records given as lists: `outputs` of shape (rows,), `inputs` of shape (rows,
    inputs). `lags` are those of output and inputs."""
    y = np.concatenate(outputs)[:, None]
    x = np.concatenate(inputs)
    of_inputs = [list(range(1, lags[1] + 1))] * x.shape[1] if x.shape[1] > 1 else lags[1]
    model = FrolsOfRecords(
        order_selection=True,
        info_criteria="bic",
        n_info_values=most_terms,
        ylag=lags[0],
        xlag=of_inputs,
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=degree),
        model_type="NFIR" if static else "NARMAX",
    )
    model.seams = np.cumsum([len(output) for output in outputs])[:-1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X=x, y=y)
        # SysIdentPy stops at the first increase of the criterion; the minimum over all orders
        # gives a better model.
        best = int(np.nanargmin(model.info_values)) + 1
        if best != model.n_terms:
            model.order_selection, model.n_terms = False, best
            model.fit(X=x, y=y)
    terms = []
    for code, theta in zip(model.final_model, np.ravel(model.theta), strict=True):
        # A factor is coded as 1000 times the variable (1: the output) plus the lag.
        factors = [(int(c) // 1000 - 1, int(c) % 1000) for c in code if c]
        terms.append((float(theta), factors))
    return Narx(terms, names, max(lags))

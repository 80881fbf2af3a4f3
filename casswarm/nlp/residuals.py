"""KKT residuals, recomputed from the problem in the same manner for every solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..typing import FloatArray
from .program import Instances, Nlp
from .solution import Residuals

ACTIVE = 1e-6
"""Relative distance from its bound up to which a row can have an estimated multiplier."""

_MAX_DENSE = 1 << 20  # entries up to which the estimate uses a dense matrix


def kkt_residuals(
    nlp: Nlp,
    instance: Instances,
    x: FloatArray,
    multipliers: tuple[FloatArray, FloatArray] | None = None,
) -> Residuals:
    """Residuals of the KKT conditions at `x`, of a single instance.

    Parameters
    ----------
    nlp, instance
        The problem; `instance` holds one row.
    x : (nx,)
    multipliers : (nx,), (ng,), optional
        Of the bounds on x and of g, positive at an upper bound. Estimated by least squares over the
        active rows if there are none.

    Returns
    -------
    Residuals
        Infinite where x or the functions at x are not finite.
    """
    point = _point(nlp, instance, x)
    if point is None:
        return Residuals(np.inf, np.inf, np.inf, "not finite")
    violations = point.violations
    violation, violated_row = float(violations.max(initial=0.0)), ""
    if violation > 0:
        row = int(violations.argmax())
        violated_row = f"bound[{row}]" if row < len(x) else nlp.row_names[row - len(x)]
    lam = _estimate(point) if multipliers is None else np.concatenate(multipliers)
    stationarity = float(np.abs(point.lagrangian_gradient(lam)).max(initial=0.0))
    slack = point.slack(lam)
    slack = np.where(np.isfinite(slack), slack, 1.0)  # a row without bound has no multiplier
    complementarity = float(np.abs(lam * slack).max(initial=0.0))
    return Residuals(violation, stationarity, complementarity, violated_row)


def relative_error(
    nlp: Nlp,
    instance: Instances,
    x: FloatArray,
    multipliers: tuple[FloatArray, FloatArray] | None = None,
    reference: FloatArray | None = None,
) -> float:
    """Error of the KKT conditions at `x`, relative to the problem's own scale.

    The least tau for which, in Euclidean norms,

    - no row is violated by a distance of more than tau L, to first order;
    - ``|grad f + J' lam| <= tau G``;
    - every row that is farther than tau L from its bound has
      ``|lam_i| |grad c_i| <= tau G``.

    L is the largest component of x and of x - reference, and G the larger norm of grad f at x and
    at the reference. The error does not change with the units of f, of any constraint, or of x as a
    whole. It follows the test of E. D. Dolan, J. J. More and T. S. Munson, Optimality measures for
    performance profiles, SIAM J. Optim. 16 (2006) 891-909, in that approximately active constraints
    replace a measure of complementarity; L and G are casswarm's choice.

    Parameters
    ----------
    nlp, instance, x, multipliers
        As in `kkt_residuals`.
    reference : (nx,), optional
        A point that shows the scale of x and of grad f, since both may be zero at a solution; by
        default the instance's x0.

    Returns
    -------
    float
        Infinite where x or the functions at x are not finite, or the gradient of a violated row is
        zero.
    """
    point = _point(nlp, instance, x)
    if point is None:
        return float("inf")
    start = instance.x0[0] if reference is None else reference
    length = max(np.abs(x).max(initial=0.0), np.abs(x - start).max(initial=0.0)) or 1.0
    at_start = np.asarray(nlp.gradient(start, instance.p[0])[1])
    slopes = (float(np.linalg.norm(gradient)) for gradient in (point.gradient, at_start))
    slope = max(filter(np.isfinite, slopes)) or 1.0
    norms = np.sqrt(np.asarray(point.columns.power(2).sum(axis=0)).ravel())
    if (point.violations[norms == 0] > 0).any():
        return float("inf")
    norms = np.where(norms > 0, norms, 1.0)
    scaled = point.scaled(length, slope, norms)
    lam = _estimate(scaled) if multipliers is None else np.concatenate(multipliers) * norms / slope
    error = max(
        scaled.violations.max(initial=0.0),
        np.linalg.norm(scaled.lagrangian_gradient(lam)),
        np.minimum(np.abs(lam), np.abs(scaled.slack(lam))).max(initial=0.0),
    )
    return float(error)


def invalid_value(nlp: Nlp, instance: Instances, x: FloatArray) -> str:
    """Name of a function or derivative that is not finite, as text; empty if all are finite.

    Parameters
    ----------
    nlp, instance
        As in `kkt_residuals`.
    x : (nx,)
        If it is not finite itself, the instance's x0 takes its place.

    Returns
    -------
    str
        Such as "the derivative of the objective with respect to positions[3] is nan".
    """
    finite = bool(np.isfinite(x).all())
    at, p = (x if finite else instance.x0[0]), instance.p[0]
    where = "" if finite and (at != instance.x0[0]).any() else " at the initial guess"
    rows = ("the objective", *(f"the constraint {name}" for name in nlp.row_names))
    values = np.concatenate([np.asarray(value).ravel() for value in nlp.evaluate(at, p)])
    if (invalid := np.flatnonzero(~np.isfinite(values))).size:
        return f"{rows[invalid[0]]} is {values[invalid[0]]:g}{where}"
    gradient = np.asarray(nlp.gradient(at, p)[1]).reshape(1, -1)
    slopes = sparse.coo_array(sparse.vstack([gradient, nlp.jacobian(at, p).sparse()]))
    if (entries := np.flatnonzero(~np.isfinite(slopes.data))).size:
        first = entries[0]
        row, variable = rows[slopes.row[first]], nlp.variable_names[slopes.col[first]]
        value = slopes.data[first]
        return f"the derivative of {row} with respect to {variable} is {value:g}{where}"
    return ""


def estimated_multipliers(nlp: Nlp, instance: Instances, x: FloatArray) -> FloatArray:
    """Multipliers (nx + ng,) of bounds and rows by least squares over the active rows at `x`.

    NaN where the functions at x are not finite.
    """
    point = _point(nlp, instance, x)
    return np.full(sum(nlp.sizes[::2]), np.nan) if point is None else _estimate(point)


class _Point(NamedTuple):
    """The functions of a problem at a point; rows are the bounds on x, then g."""

    gradient: FloatArray  # of the objective, (nx,)
    columns: sparse.csc_array  # gradients of the rows, (nx, nx + ng)
    values: FloatArray  # of the rows, (nx + ng,)
    lower: FloatArray
    upper: FloatArray

    @property
    def violations(self) -> FloatArray:
        """By how much each row exceeds its bounds."""
        return np.maximum(np.maximum(self.lower - self.values, self.values - self.upper), 0.0)

    def lagrangian_gradient(self, lam: FloatArray) -> FloatArray:
        """Gradient of the Lagrangian with multipliers (nx + ng,)."""
        return np.asarray(self.gradient + self.columns @ lam)

    def slack(self, lam: FloatArray) -> FloatArray:
        """Distance of each row from the bound that its multiplier belongs to."""
        return np.where(lam > 0, self.upper - self.values, self.values - self.lower)

    def scaled(self, length: float, slope: float, norms: FloatArray) -> _Point:
        """The functions in units of x, of the objective's gradient, and of the rows' gradients."""
        units = length * norms
        columns = sparse.csc_array(self.columns @ sparse.diags_array(1.0 / norms))
        rows = (self.values / units, self.lower / units, self.upper / units)
        return _Point(self.gradient / slope, columns, *rows)


def _point(nlp: Nlp, instance: Instances, x: FloatArray) -> _Point | None:
    """The functions at x; None where they are not finite."""
    p = instance.p[0]
    objective, g = (np.asarray(value).ravel() for value in nlp.evaluate(x, p))
    if not (np.isfinite(x).all() and np.isfinite(objective).all() and np.isfinite(g).all()):
        return None
    jacobian = nlp.jacobian(x, p).sparse()
    return _Point(
        gradient=np.asarray(nlp.gradient(x, p)[1]).ravel(),
        columns=sparse.hstack([sparse.eye_array(len(x)), sparse.csr_array(jacobian).T]).tocsc(),
        values=np.concatenate([x, g]),
        lower=np.concatenate([instance.lbx[0], instance.lbg[0]]),
        upper=np.concatenate([instance.ubx[0], instance.ubg[0]]),
    )


def _estimate(point: _Point) -> FloatArray:
    """Multipliers of the active rows that minimise the Lagrangian's gradient."""
    from scipy.optimize import lsq_linear  # slow to import, and seldom needed

    values, lower, upper = point.values, point.lower, point.upper
    scale = ACTIVE * np.maximum(1.0, np.abs(values))
    at_upper, at_lower = upper - values <= scale, values - lower <= scale
    active = np.flatnonzero(at_upper | at_lower)
    lam = np.zeros(len(values))
    if active.size:
        low = np.where(at_lower[active], -np.inf, 0.0)
        high = np.where(at_upper[active], np.inf, 0.0)
        rows = point.columns[:, active]
        small = rows.shape[0] * active.size <= _MAX_DENSE
        matrix, method = (rows.toarray(), "bvls") if small else (rows, "trf")
        lam[active] = lsq_linear(matrix, -point.gradient, (low, high), method=method).x
    return lam

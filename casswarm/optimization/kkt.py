"""KKT residuals, recomputed from the problem in the same manner for every solver."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..typing import FloatArray
from .problem import Instances, Nlp
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
    p = instance.p[0]
    objective, g = (np.asarray(value).ravel() for value in nlp.evaluate(x, p))
    if not (np.isfinite(x).all() and np.isfinite(objective).all() and np.isfinite(g).all()):
        return Residuals(np.inf, np.inf, np.inf, "not finite")
    values = np.concatenate([x, g])
    lower = np.concatenate([instance.lbx[0], instance.lbg[0]])
    upper = np.concatenate([instance.ubx[0], instance.ubg[0]])
    violations = np.maximum(np.maximum(lower - values, values - upper), 0.0)
    violation, violated_row = float(violations.max(initial=0.0)), ""
    if violation > 0:
        row = int(violations.argmax())
        violated_row = f"bound[{row}]" if row < len(x) else nlp.row_names[row - len(x)]

    gradient = np.asarray(nlp.gradient(x, p)[1]).ravel()
    jacobian = nlp.jacobian(x, p).sparse()
    columns = sparse.hstack([sparse.eye_array(len(x)), sparse.csr_array(jacobian).T]).tocsc()
    if multipliers is None:
        lam = _estimate(columns, gradient, values, lower, upper)
    else:
        lam = np.concatenate(multipliers)
    stationarity = float(np.abs(gradient + columns @ lam).max(initial=0.0))
    slack = np.where(lam > 0, upper - values, values - lower)
    slack = np.where(np.isfinite(slack), slack, 1.0)  # a row without bound has no multiplier
    complementarity = float(np.abs(lam * slack).max(initial=0.0))
    return Residuals(violation, stationarity, complementarity, violated_row)


def _estimate(
    columns: sparse.csc_array,
    gradient: FloatArray,
    values: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> FloatArray:
    """Multipliers of the active rows that minimise the Lagrangian's gradient."""
    from scipy.optimize import lsq_linear  # slow to import, and seldom needed

    scale = ACTIVE * np.maximum(1.0, np.abs(values))
    at_upper, at_lower = upper - values <= scale, values - lower <= scale
    active = np.flatnonzero(at_upper | at_lower)
    lam = np.zeros(len(values))
    if active.size:
        low = np.where(at_lower[active], -np.inf, 0.0)
        high = np.where(at_upper[active], np.inf, 0.0)
        rows = columns[:, active]
        small = rows.shape[0] * active.size <= _MAX_DENSE
        matrix, method = (rows.toarray(), "bvls") if small else (rows, "trf")
        lam[active] = lsq_linear(matrix, -gradient, (low, high), method=method).x
    return lam

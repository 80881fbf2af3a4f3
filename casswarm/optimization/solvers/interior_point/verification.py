"""Residuals of the method's answers, recomputed from the problem."""

from __future__ import annotations

import numpy as np

from ....typing import FloatArray, IntArray
from ...problem import Instances
from ...solution import BatchSolution, Status
from ..base import VIOLATION
from .iterates import Results
from .problems import Problems
from .scaling import Scaling

STATIONARITY = 1e-4
"""Largest residual of the optimality conditions in the method's units, relative to multipliers."""


def verified(
    problems: Problems, instances: Instances, results: Results, scaling: Scaling, width: int
) -> BatchSolution:
    """Results with residuals of the problem; `width` instances are linearised at a time.

    Solutions without feasibility, stationarity or finite values are failures.
    """
    size = len(instances)
    objective, violation, gradient, products = np.empty((4, size))
    with np.errstate(all="ignore"):
        for start in range(0, size, width):
            some = slice(start, min(start + width, size))
            objective[some], violation[some], gradient[some], products[some] = _residuals(
                problems, instances[some], results, np.arange(size)[some]
            )
        length, value = instances.scale.T
        stationarity = np.maximum(length / value * gradient, products / value)
        relative = scaling.objective * np.maximum(scaling.length * gradient, products)
        relative /= np.maximum(1.0, _largest_multipliers(results, scaling))
    claimed = np.array([status.success for status in results.status], dtype=bool)
    faults = {
        "a residual is not finite": ~np.isfinite(objective + stationarity + violation),
        "a constraint is violated by more than 1e-06": violation > VIOLATION,
        "the point is not stationary": relative > STATIONARITY,
    }
    messages = np.array(
        [f"{status}: {text}" for status, text in zip(results.status, results.message, strict=True)],
        dtype=object,
    )
    for text, faulty in faults.items():
        messages[claimed & faulty] = f"{Status.FAILED}: {text}"
        claimed &= ~faulty
    return BatchSolution(
        x=results.x,
        objective=objective,
        success=claimed,
        violation=violation,
        stationarity=stationarity,
        used_fallback=np.zeros(size, bool),
        seconds=0.0,
        messages=messages,
    )


def _residuals(
    problems: Problems, instances: Instances, results: Results, rows: IntArray
) -> tuple[FloatArray, ...]:
    """Objective, violation, largest entry of the Lagrangian's gradient, and complementarity."""
    x, lam_x, lam_g = (part[rows] for part in (results.x, results.lam_x, results.lam_g))
    by_column = np.ascontiguousarray(x.T)
    objective, g = problems.evaluate(rows, by_column)
    at = problems.linearise(rows, by_column)
    lagrangian = (at.gradient + at.transposed_times(np.ascontiguousarray(lam_g.T))).T + lam_x
    values, lam = np.hstack([x, g.T]), np.hstack([lam_x, lam_g])
    below = np.hstack([instances.lbx, instances.lbg]) - values
    above = values - np.hstack([instances.ubx, instances.ubg])
    slack = np.where(lam > 0.0, above, below)
    products = abs(lam * np.where(np.isfinite(slack), slack, 1.0))  # as `kkt_residuals`
    return (
        objective,
        np.maximum(below, above).max(axis=1, initial=0.0),
        abs(lagrangian).max(axis=1, initial=0.0),
        products.max(axis=1, initial=0.0),
    )


def _largest_multipliers(results: Results, scaling: Scaling) -> FloatArray:
    """Largest absolute multipliers (B,) in the method's units."""
    of_x = abs(results.lam_x).max(axis=1, initial=0.0) * scaling.length
    of_g = (abs(results.lam_g) / scaling.rows.T).max(axis=1, initial=0.0)
    return np.asarray(scaling.objective * np.maximum(of_x, of_g))

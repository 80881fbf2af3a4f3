"""Compiled loops over the entries of iterates: residuals, right-hand sides, multipliers.

Arrays (k, b) hold numbers of b instances, so the inner loops do an operation for all of them.
"""

from __future__ import annotations

import math

from ...._util.jit import kernel
from ....typing import BoolArray, FloatArray
from .lane_kernels import EQUALITY, FIXED

LARGE = 100.0
"""Mean multiplier from which residuals are relative to it."""

_NEAR = 1e10  # factor by which a multiplier may differ from mu / gap
_ROUNDING = 2.0**-50  # relative to y: gaps up to that are rounding error
_ULP = 2.0**-51  # relative to y: rounding error of its gaps
_WIDER = 2.0**-39  # relative to y: gaps to which bounds are moved, eps^(3/4) as in Ipopt


@kernel
def residuals(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray, BoolArray],
    terms: tuple[FloatArray, FloatArray, FloatArray],
    results: tuple[FloatArray, FloatArray],
    out: FloatArray,
) -> None:
    """Write what the conditions of optimality lack.

    The `results` are the gradient (k, b) of f + lam' (g - s), and g - s (ng, b). `out` (5, b) are
    the largest entry of the Lagrangian's gradient, the least and the largest product of a
    multiplier and its gap, up to the rounding of y, the largest violation, and what residuals are
    relative to. `point` is (y, z, lam), `bounds` (lower, upper, fixed), `terms` (gradient of f,
    J' lam, g).
    """
    (y, z, lam), (lower, upper, fixed) = point, bounds
    (objective, pulled, g), (gradient, primal) = terms, results
    size, rows, batch = len(objective), len(lam), y.shape[1]
    dual, least, most, violation, total = out[0], out[1], out[2], out[3], out[4]
    for i in range(batch):
        dual[i], least[i], most[i], violation[i], total[i] = 0.0, math.inf, -math.inf, 0.0, 0.0
    for k in range(rows):
        for i in range(batch):
            gradient[size + k, i] = -lam[k, i]
            primal[k, i] = g[k, i] - y[size + k, i]
            total[i] += abs(lam[k, i])
            violation[i] = largest(violation[i], abs(primal[k, i]))
    for k in range(size):
        for i in range(batch):
            gradient[k, i] = objective[k, i] + pulled[k, i]
    for k in range(len(y)):
        for i in range(batch):
            below, above = z[0, k, i], z[1, k, i]
            total[i] += abs(above - below)
            error = 0.0 if fixed[k, i] else abs(gradient[k, i] - below + above)
            dual[i] = largest(dual[i], error)
            has_lower, has_upper = lower[k, i] > -math.inf, upper[k, i] < math.inf
            one = below * (y[k, i] - lower[k, i] if has_lower else 0.0)
            two = above * (upper[k, i] - y[k, i] if has_upper else 0.0)
            error = _ULP * abs(y[k, i])  # of the gaps
            least[i] = min(least[i], one + below * error if has_lower else math.inf)
            least[i] = min(least[i], two + above * error if has_upper else math.inf)
            most[i] = max(most[i], one - below * error if has_lower else -math.inf)
            most[i] = max(most[i], two - above * error if has_upper else -math.inf)
    for i in range(batch):
        total[i] = max(LARGE, total[i] / (rows + 2 * len(y))) / LARGE


@kernel
def largest(one: float, two: float) -> float:
    """The larger number; NaN if one is."""
    return one if one > two or math.isnan(one) else two


@kernel
def barrier_terms(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray, BoolArray],
    gradients: tuple[FloatArray, FloatArray],
    results: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Write what Newton's equations need of the bounds, (k, b) each.

    The `results` are the bounds' weights, the gradient of the barrier function plus lam' (g - s),
    and that of the barrier function alone; both gradients are zero where y is fixed. `point` is
    (y, z, mu), `bounds` (lower, upper, fixed), `gradients` those of f + lam' (g - s) and of f.
    """
    (y, z, mu), (lower, upper, fixed) = point, bounds
    (lagrangian, objective), (weights, gradient, ascent) = gradients, results
    size = len(objective)
    for k in range(len(y)):
        infinite = FIXED if k < size else EQUALITY
        for i in range(y.shape[1]):
            below, above = 1.0 / (y[k, i] - lower[k, i]), 1.0 / (upper[k, i] - y[k, i])
            barrier = mu[i] * (above - below)
            weight = z[0, k, i] * below + z[1, k, i] * above
            weights[k, i] = infinite if fixed[k, i] else weight
            ascent[k, i] = 0.0 if fixed[k, i] else barrier
            gradient[k, i] = 0.0 if fixed[k, i] else lagrangian[k, i] + barrier
    for k in range(size):
        for i in range(y.shape[1]):
            ascent[k, i] += 0.0 if fixed[k, i] else objective[k, i]


@kernel
def condense(
    weights: FloatArray, gradient: FloatArray, primal: FloatArray, pull: FloatArray
) -> None:
    """Write the vectors (ng, b) whose products with J' condensation adds to the right-hand side."""
    size = len(gradient) - len(primal)
    for k in range(len(primal)):
        for i in range(primal.shape[1]):
            pull[k, i] = weights[size + k, i] * primal[k, i] + gradient[size + k, i]


@kernel
def right_hand_sides(
    gradient: FloatArray, pulled: FloatArray, fixed: BoolArray, right: FloatArray
) -> None:
    """Write minus the condensed gradients (n, b), zero where x is fixed."""
    for k in range(len(right)):
        for i in range(right.shape[1]):
            right[k, i] = 0.0 if fixed[k, i] else -(gradient[k, i] + pulled[k, i])


@kernel
def expand(
    changes: tuple[FloatArray, FloatArray],
    equations: tuple[FloatArray, FloatArray, FloatArray, BoolArray],
    step: FloatArray,
    multipliers: FloatArray,
) -> None:
    """Write the steps of y (k, b) and of the multipliers (ng, b) that condensation left out.

    `changes` are dx and J dx; `equations` (weights, gradient, g - s, fixed).
    """
    (dx, along), (weights, gradient, primal, fixed) = changes, equations
    size, batch = len(dx), step.shape[1]
    for k in range(size):
        for i in range(batch):
            step[k, i] = 0.0 if fixed[k, i] else dx[k, i]
    for k in range(len(primal)):
        for i in range(batch):
            ds = along[k, i] + primal[k, i]
            multipliers[k, i] = weights[size + k, i] * ds + gradient[size + k, i]
            step[size + k, i] = 0.0 if fixed[size + k, i] else ds


@kernel
def move_multipliers(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    step: FloatArray,
    keep: FloatArray,
    work: tuple[FloatArray, FloatArray],
    z: FloatArray,
) -> None:
    """Move the multipliers z (2, k, b) of the bounds with a step of y, where that was taken.

    `point` is (y before, y after, mu). A fraction `keep` (b,) of every multiplier is kept. `work`
    are the changes (2, k, b), and lengths (b,), which are 0 where no step was taken, or 1.
    """
    (before, after, mu), (lower, upper), (changes, lengths) = point, bounds, work
    batch = before.shape[1]
    for k in range(len(before)):
        for i in range(batch):
            below, above = before[k, i] - lower[k, i], upper[k, i] - before[k, i]
            one, two = z[0, k, i], z[1, k, i]
            changes[0, k, i] = (mu[i] - one * step[k, i]) / below - one
            changes[1, k, i] = (mu[i] + two * step[k, i]) / above - two
            for side in range(2):
                change, value = changes[side, k, i], z[side, k, i]
                limit = (keep[i] - 1.0) * value / change
                lengths[i] = min(lengths[i], limit if change < 0.0 else 1.0)
    for side in range(2):
        for k in range(len(before)):
            for i in range(batch):
                below, above = after[k, i] - lower[k, i], upper[k, i] - after[k, i]
                ideal = mu[i] / (below if side == 0 else above)
                value = z[side, k, i] + lengths[i] * changes[side, k, i]
                value = min(max(value, ideal / _NEAR), ideal * _NEAR)
                z[side, k, i] = value if lengths[i] > 0.0 else z[side, k, i]


@kernel
def widen(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    moved: BoolArray,
) -> None:
    """Move bounds to which y has come so near that the gap is rounding error.

    `moved` (b,) tells whose bounds may be moved, and then, whose were. `point` is (y, z, mu).
    """
    (y, z, mu), (lower, upper) = point, bounds
    for i in range(len(moved)):
        may, moved[i] = moved[i], False
        for k in range(len(y) if may else 0):
            size = max(1.0, abs(y[k, i]))
            gap = _WIDER * size
            if y[k, i] - lower[k, i] <= _ROUNDING * size:
                lower[k, i], z[0, k, i], moved[i] = y[k, i] - gap, mu[i] / gap, True
            if upper[k, i] - y[k, i] <= _ROUNDING * size:
                upper[k, i], z[1, k, i], moved[i] = y[k, i] + gap, mu[i] / gap, True

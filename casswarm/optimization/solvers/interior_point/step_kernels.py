"""Compiled loops over the entries of iterates: residuals, right-hand sides, multipliers."""

from __future__ import annotations

import math

from ...._util.jit import kernel
from ....typing import BoolArray, FloatArray

LARGE = 100.0
"""Mean multiplier from which residuals are relative to it."""

_EQUALITY = 1e8  # weight of rows of g with equal bounds, instead of an infinite one
_FIXED = 1e20  # weight of variables with equal bounds
_NEAR = 1e10  # factor by which a multiplier may differ from mu / gap


@kernel
def residuals(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray, BoolArray],
    gradient: FloatArray,
    primal: FloatArray,
    out: FloatArray,
) -> None:
    """Write what the conditions of optimality lack, (b, 5).

    The largest entry of the Lagrangian's gradient, the least and the largest product of a
    multiplier and its gap, the largest violation, and what residuals are relative to. `point` is
    (y, z, lam), `bounds` (lower, upper, fixed).
    """
    (y, z, lam), (lower, upper, fixed) = point, bounds
    for i in range(len(y)):
        dual, least, most, violation, total = 0.0, math.inf, -math.inf, 0.0, 0.0
        for k in range(y.shape[1]):
            error = abs(gradient[i, k] - z[i, 0, k] + z[i, 1, k])
            if not fixed[i, k] and (error > dual or math.isnan(error)):
                dual = error
            total += z[i, 0, k] + z[i, 1, k]
            if lower[i, k] > -math.inf:
                product = z[i, 0, k] * (y[i, k] - lower[i, k])
                least, most = min(least, product), max(most, product)
            if upper[i, k] < math.inf:
                product = z[i, 1, k] * (upper[i, k] - y[i, k])
                least, most = min(least, product), max(most, product)
        for k in range(lam.shape[1]):
            total += abs(lam[i, k])
            error = abs(primal[i, k])
            if error > violation or math.isnan(error):
                violation = error
        mean = total / (lam.shape[1] + 2 * y.shape[1])
        out[i, 0], out[i, 1], out[i, 2] = dual, least, most
        out[i, 3], out[i, 4] = violation, max(LARGE, mean) / LARGE


@kernel
def barrier_terms(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray, BoolArray],
    size: int,
    barrier: FloatArray,
    weights: FloatArray,
) -> None:
    """Write the barrier's gradient and the bounds' weights, (b, k), of which `size` are of x.

    `point` is (y, z, mu), `bounds` (lower, upper, fixed).
    """
    (y, z, mu), (lower, upper, fixed) = point, bounds
    for i in range(len(y)):
        for k in range(y.shape[1]):
            below, above = 1.0 / (y[i, k] - lower[i, k]), 1.0 / (upper[i, k] - y[i, k])
            barrier[i, k] = mu[i] * (above - below)
            weights[i, k] = z[i, 0, k] * below + z[i, 1, k] * above
            if fixed[i, k]:
                weights[i, k] = _FIXED if k < size else _EQUALITY


@kernel
def move_multipliers(
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    step: FloatArray,
    keep: FloatArray,
    moved: BoolArray,
    z: FloatArray,
) -> None:
    """Move the multipliers z (b, 2, k) of the bounds with a step of y, where that was taken.

    `point` is (y before, y after, mu). A fraction `keep` (b,) of every multiplier is kept.
    """
    (before, after, mu), (lower, upper) = point, bounds
    for i in range(len(z)):
        if not moved[i]:
            continue
        length = 1.0
        for k in range(z.shape[2]):
            gaps = before[i, k] - lower[i, k], upper[i, k] - before[i, k]
            for side in range(2):
                change = changed(z[i, side, k], gaps[side], mu[i], step[i, k], side)
                if change < 0.0:
                    length = min(length, (keep[i] - 1.0) * z[i, side, k] / change)
        for k in range(z.shape[2]):
            gaps = before[i, k] - lower[i, k], upper[i, k] - before[i, k]
            ends = after[i, k] - lower[i, k], upper[i, k] - after[i, k]
            for side in range(2):
                change = changed(z[i, side, k], gaps[side], mu[i], step[i, k], side)
                ideal = mu[i] / ends[side]
                value = z[i, side, k] + length * change
                z[i, side, k] = min(max(value, ideal / _NEAR), ideal * _NEAR)


@kernel
def changed(z: float, gap: float, mu: float, step: float, side: int) -> float:
    """Newton's change of a multiplier of a lower (side 0) or upper bound."""
    toward = step if side else -step
    return (mu + z * toward) / gap - z

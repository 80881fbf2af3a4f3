"""Compiled loops of the line search: trial points, the barrier, and the filter.

Arrays (k, b) hold numbers of b instances; `rows` (r,) are those of them that are searched.
"""

from __future__ import annotations

import math

from ...._util.jit import kernel
from ....typing import BoolArray, FloatArray, IntArray

_FEASIBLE, _FAR = 1e-4, 1e4  # of the initial violation: where progress in f counts, the limit
_MARGIN, _ARMIJO = 1e-5, 1e-4
_ROUNDING = 10 * 2.0**-52
_FACTORS = 4  # entries whose gaps are multiplied before a logarithm is taken


@kernel
def log_barrier(
    y: FloatArray, lower: FloatArray, upper: FloatArray, work: FloatArray, out: FloatArray
) -> None:
    """Write minus the sums (b,) of the logarithms of all finite gaps of y (k, b).

    NaN where a gap is not positive. `work` is (2, b).
    """
    product, least = work[0], work[1]
    batch = y.shape[1]
    out[:], product[:], least[:] = 0.0, 1.0, math.inf
    for k in range(len(y)):
        for i in range(batch):
            below, above = y[k, i] - lower[k, i], upper[k, i] - y[k, i]
            smaller = below if below < above else above
            # a comparison with NaN is false
            least[i] = least[i] if smaller >= least[i] else smaller
            product[i] *= below if below < math.inf else 1.0
            product[i] *= above if above < math.inf else 1.0
        if (k + 1) % _FACTORS == 0 or k + 1 == len(y):
            for i in range(batch):
                out[i] -= math.log(product[i])
                product[i] = 1.0
    for i in range(batch):
        out[i] = out[i] if least[i] > 0.0 else math.nan


@kernel
def longest_steps(
    point: tuple[FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    keep: FloatArray,
    out: FloatArray,
) -> None:
    """Write the largest lengths (b,) up to 1 after which each gap keeps a fraction `keep` (b,).

    `point` are y and its step (k, b).
    """
    (y, step), (lower, upper) = point, bounds
    out[:] = 1.0
    for k in range(len(y)):
        for i in range(y.shape[1]):
            change = step[k, i]
            gap = lower[k, i] - y[k, i] if change < 0.0 else upper[k, i] - y[k, i]
            limit = (1.0 - keep[i]) * gap / change
            out[i] = out[i] if limit >= out[i] or change == 0.0 else limit


@kernel
def trial_points(
    rows: IntArray,
    point: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    trial: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Write y (k, r) after the steps of some instances, and their bounds (k, r).

    `point` are y, its step, and the length (b,) of that.
    """
    (y, step, length), (lower, upper), (ends, below, above) = point, bounds, trial
    for k in range(len(y)):
        for j in range(len(rows)):
            i = rows[j]
            ends[k, j] = y[k, i] + length[i] * step[k, i]
            below[k, j], above[k, j] = lower[k, i], upper[k, i]


@kernel
def slopes(ascent: FloatArray, step: FloatArray, out: FloatArray) -> None:
    """Write the slopes (b,) of functions with gradients (k, b) along steps."""
    out[:] = 0.0
    for k in range(len(step)):
        for i in range(step.shape[1]):
            out[i] += ascent[k, i] * step[k, i]


@kernel
def violations(g: FloatArray, y: FloatArray, out: FloatArray) -> None:
    """Write the sums (r,) of |g - s|, with the slacks s at the end of y."""
    size = len(y) - len(g)
    out[:] = 0.0
    for k in range(len(g)):
        for j in range(g.shape[1]):
            out[j] += abs(g[k, j] - y[size + k, j])


@kernel
def judge(
    rows: IntArray,
    lines: FloatArray,
    entries: tuple[FloatArray, IntArray, FloatArray],
    trial: tuple[FloatArray, FloatArray, FloatArray],
    accepted: BoolArray,
) -> None:
    """Write which trial points of some instances are accepted.

    `lines` (3, b) are the violation, barrier function and slope of the current points; `entries`
    the filters (2, m, b), their numbers and their scales; `trial` length (b,), and violation and
    barrier function (r,).
    """
    (filters, numbers, scales), (lengths, violation, merit) = entries, trial
    for j in range(len(rows)):
        i = rows[j]
        before, function, slope = lines[0, i], lines[1, i], lines[2, i]
        allowed = function + _ROUNDING * abs(function)
        ok = violation[j] <= _FAR * scales[i] and math.isfinite(merit[j])
        for e in range(numbers[i]):
            ok = ok and (violation[j] < filters[0, e, i] or merit[j] < filters[1, e, i])
        if before <= _FEASIBLE * scales[i] and switches(lengths[i], slope, before):
            ok = ok and merit[j] <= allowed + _ARMIJO * lengths[i] * slope
        else:
            less = violation[j] <= (1.0 - _MARGIN) * before
            ok = ok and (less or merit[j] <= allowed - _MARGIN * before)
        accepted[j] = ok


@kernel
def remember(
    rows: IntArray,
    lines: FloatArray,
    entries: tuple[FloatArray, IntArray],
    trial: tuple[FloatArray, FloatArray],
) -> None:
    """Add the current points to the filters where a step was not one that reduces f.

    Arguments are those of `judge`; `trial` are length (b,), and barrier function (r,).
    """
    (filters, numbers), (lengths, merit) = entries, trial
    for j in range(len(rows)):
        i = rows[j]
        before, function, slope = lines[0, i], lines[1, i], lines[2, i]
        limit = function + _ROUNDING * abs(function) + _ARMIJO * lengths[i] * slope
        if not (switches(lengths[i], slope, before) and merit[j] <= limit):
            add_entry(filters, numbers, i, before, function)


@kernel
def add_entry(
    filters: FloatArray, numbers: IntArray, i: int, violation: float, merit: float
) -> None:
    """Add a point to a filter, less a margin."""
    filters[0, numbers[i], i] = (1.0 - _MARGIN) * violation
    filters[1, numbers[i], i] = merit - _MARGIN * violation
    numbers[i] += 1


@kernel
def add_entries(
    filters: FloatArray, numbers: IntArray, violations: FloatArray, merits: FloatArray
) -> None:
    """Add a point to every filter."""
    for i in range(len(numbers)):
        add_entry(filters, numbers, i, violations[i], merits[i])


@kernel
def switches(length: float, slope: float, violation: float) -> bool:
    """Whether the slope promises more than the violation can cost."""
    promised: float = length * max(-slope, 0.0) ** 2.3
    return bool(promised > violation**1.1)

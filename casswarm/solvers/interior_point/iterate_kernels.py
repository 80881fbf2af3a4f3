"""Compiled loops over the entries of iterates: residuals, trial points, the barrier, the filter.

Arrays (k, b) hold numbers of b instances, so the inner loops do an operation for all of them;
`rows` (r,) are those of them that are searched.
"""

from __future__ import annotations

import math

from ...compiled.kernels import kernel
from ...typing import BoolArray, FloatArray, IntArray

LANES = 64
"""Number of instances for which an operation is done before the next one."""

EQUALITY, FIXED = 1e8, 1e20
"""Weights of rows of g, and of variables, with equal bounds, instead of infinite ones."""


LARGE = 100.0
"""Mean multiplier from which residuals are relative to it."""

KEEP = 0.01
"""Fraction of every gap and multiplier that a step keeps, or mu where that is less."""

_SOLVED = 10.0  # residual of a barrier problem that counts as solved, in units of mu
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
def is_solved(
    mu: float, errors: tuple[float, float, float, float, float], tolerance: float
) -> bool:
    """Return True if a barrier problem is solved; `errors` are those of `residuals`.

    The Lagrangian's gradient need not be below `tolerance`.
    """
    dual, least, most, violation, scale = errors
    limit = _SOLVED * mu
    complementary = (most - mu) / scale <= limit and (mu - least) / scale <= limit
    return bool(complementary and dual / scale <= max(limit, tolerance) and violation <= limit)


@kernel
def smaller_mu(
    mu: float, errors: tuple[float, float, float, float, float], final: float, tolerance: float
) -> float:
    """Barrier parameter, reduced as long as its problem is solved, at most to the `final` one."""
    while mu > final and is_solved(mu, errors, tolerance):
        mu = max(final, min(0.2 * mu, mu**1.5))
    return mu


@kernel
def reduce_mu(largest: FloatArray, final: FloatArray, mu: FloatArray, reduced: BoolArray) -> None:
    """Reduce barrier parameters (b,) to at least `final` (b,), and write which were reduced.

    `largest` (5, b) are the errors of `residuals`.
    """
    for i in range(len(mu)):
        errors = largest[0, i], largest[1, i], largest[2, i], largest[3, i], largest[4, i]
        smaller = smaller_mu(mu[i], errors, final[i], 0.0)
        reduced[i], mu[i] = smaller < mu[i], smaller


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
    gaps: tuple[FloatArray, FloatArray],
    mu: FloatArray,
    step: FloatArray,
    keep: FloatArray,
    work: tuple[FloatArray, FloatArray],
    z: FloatArray,
) -> None:
    """Move the multipliers z of `gaps` with a step, where that was taken.

    Gaps, before and after it, are (1, k, b), or (2, k, b) with those of upper bounds, which the
    step (k, b) reduces. A fraction `keep` (b,) of every multiplier is kept. `work` are the changes,
    and lengths (b,), which are 0 where no step was taken, or 1.
    """
    (before, after), (changes, lengths) = gaps, work
    sides, size, batch = z.shape
    for side in range(sides):
        sign = 1.0 - 2.0 * side
        for k in range(size):
            for i in range(batch):
                value = z[side, k, i]
                moved = mu[i] - sign * value * step[k, i]
                change = moved / before[side, k, i] - value
                limit = (keep[i] - 1.0) * value / change
                lengths[i] = min(lengths[i], limit if change < 0.0 else 1.0)
                changes[side, k, i] = change
    for side in range(sides):
        for k in range(size):
            for i in range(batch):
                ideal = mu[i] / after[side, k, i]
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


_FEASIBLE, _FAR = 1e-4, 1e4  # of the initial violation: where progress in f counts, the limit
_MARGIN, _ARMIJO = 1e-5, 1e-4
_VALUE_ROUNDING = 10 * 2.0**-52
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

    `point` are y, its step, and the lengths (r,) of that.
    """
    (y, step, length), (lower, upper), (ends, below, above) = point, bounds, trial
    for k in range(len(y)):
        for j in range(len(rows)):
            i = rows[j]
            ends[k, j] = y[k, i] + length[j] * step[k, i]
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
    the filters (2, m, b), their numbers and their scales; `trial` lengths, violations and barrier
    functions (r,).
    """
    (filters, numbers, scales), (lengths, violation, merit) = entries, trial
    for j in range(len(rows)):
        i = rows[j]
        before, function, slope = lines[0, i], lines[1, i], lines[2, i]
        allowed = function + _VALUE_ROUNDING * abs(function)
        ok = violation[j] <= _FAR * scales[i] and math.isfinite(merit[j])
        for e in range(numbers[i]):
            ok = ok and (violation[j] < filters[0, e, i] or merit[j] < filters[1, e, i])
        if before <= _FEASIBLE * scales[i] and switches(lengths[j], slope, before):
            ok = ok and merit[j] <= allowed + _ARMIJO * lengths[j] * slope
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

    Arguments are those of `judge`; `trial` are lengths and barrier functions (r,).
    """
    (filters, numbers), (lengths, merit) = entries, trial
    for j in range(len(rows)):
        i = rows[j]
        before, function, slope = lines[0, i], lines[1, i], lines[2, i]
        limit = function + _VALUE_ROUNDING * abs(function) + _ARMIJO * lengths[j] * slope
        if not (switches(lengths[j], slope, before) and merit[j] <= limit):
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
    """Switching condition: True if the slope promises more than the violation can cost."""
    promised: float = length * max(-slope, 0.0) ** 2.3
    return bool(promised > violation**1.1)

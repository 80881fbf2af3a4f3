"""Projected gradient methods, state by state.

The nonmonotone spectral one, as `SpectralProjectedGradient` describes it, identifies the face of
the set that the minimum lies on, and Newton steps on that face speed up its end. Every member has a
spectral step size of its own: the set is a product over members, and in large swarms their
curvatures differ by orders of magnitude. At the end, the paper's method with a constant step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..motion.planar_kernels import clip, nearest, violation
from ..typing import FloatArray, IntArray
from .face_kernels import (
    DIRECTION,
    GRADIENT,
    TRIAL,
    TRIAL_GRADIENT,
    Problem,
    Workspace,
    copy,
    evaluate,
    largest_component,
    longest_displacement,
    newton_step,
)
from .spectral_kernels import (
    CONVERGED,
    EXHAUSTED,
    LARGE_SWARM,
    LONGEST,
    MEMORY,
    NOT_FINITE,
    SHORTEST,
    STALLED,
    SUFFICIENT,
)

SPREAD = 100.0  # largest ratio of a member's step size to that of all
PATIENCE = 4  # spectral steps before a Newton step; doubled when one is refused
TRIALS = 60  # of a spectral step's length


@kernel
def project(x: FloatArray, sets: FloatArray, out: FloatArray) -> None:
    """Write the nearest point of the product of sets (n, 13)."""
    for i in range(sets.shape[0]):
        px, py, exists = nearest(x[2 * i], x[2 * i + 1], sets, i)
        if not exists:  # a sliver as thin as rounding: keep to the box; `verify` reports the rest
            px = clip(x[2 * i], sets[i, 0], sets[i, 2])
            py = clip(x[2 * i + 1], sets[i, 1], sets[i, 3])
        out[2 * i], out[2 * i + 1] = px, py


@kernel
def projected_step(
    x: FloatArray,
    gradient: FloatArray,
    step_sizes: FloatArray,
    sets: FloatArray,
    direction: FloatArray,
) -> float:
    """Write P(x - step_sizes gradient) - x, with a step size per member; return its slope."""
    slope = 0.0
    for i in range(sets.shape[0]):
        direction[2 * i] = x[2 * i] - step_sizes[i] * gradient[2 * i]
        direction[2 * i + 1] = x[2 * i + 1] - step_sizes[i] * gradient[2 * i + 1]
    project(direction, sets, direction)
    for i in range(sets.shape[0]):
        direction[2 * i] -= x[2 * i]
        direction[2 * i + 1] -= x[2 * i + 1]
        slope += direction[2 * i] * gradient[2 * i] + direction[2 * i + 1] * gradient[2 * i + 1]
    return slope


@kernel
def converged(x: FloatArray, problem: Problem, work: Workspace, tolerance: float) -> bool:
    """Return True if no member of P(x - metric gradient) - x is longer than the tolerance.

    The length of a member's part grows with its step size, and falls when divided by it: these
    bounds from `direction`, which has the spectral step sizes, mostly suffice.
    """
    direction, step_sizes = work.vectors[DIRECTION], work.step_sizes
    metric = problem.scale[0] * problem.scale[0] / problem.scale[1]
    limit: float = tolerance * problem.scale[0]
    low, high = 0.0, 0.0
    for i in range(step_sizes.size):
        dx, dy = direction[2 * i], direction[2 * i + 1]
        square, ratio = dx * dx + dy * dy, metric / step_sizes[i]
        low = max(low, square * min(1.0, ratio * ratio))
        high = max(high, square * max(1.0, ratio * ratio))
    if math.sqrt(high) <= limit:
        return True
    if math.sqrt(low) > limit:
        return False
    equal, residual = work.vectors[TRIAL_GRADIENT, : step_sizes.size], work.vectors[TRIAL]
    equal[:] = metric
    projected_step(x, work.vectors[GRADIENT], equal, problem.sets, residual)
    return longest_displacement(residual) <= limit


@kernel
def spectral_steps(
    displacement: FloatArray, change: FloatArray, metric: float, step_sizes: FloatArray
) -> None:
    """Write every member's step size: its inverse curvature, within `SPREAD` of that of all.

    `displacement` and `change` are the differences of the last two points and gradients.
    """
    squares, curvatures = 0.0, 0.0
    for c in range(displacement.size):
        squares += displacement[c] * displacement[c]
        curvatures += displacement[c] * change[c]
    common = squares / abs(curvatures) if curvatures != 0.0 else LONGEST * metric
    common = clip(common, SHORTEST * metric, LONGEST * metric)
    for i in range(step_sizes.size):
        sx, sy = displacement[2 * i], displacement[2 * i + 1]
        square, curvature = sx * sx + sy * sy, sx * change[2 * i] + sy * change[2 * i + 1]
        own = square / abs(curvature) if curvature != 0.0 else common
        step_sizes[i] = clip(own, common / SPREAD, common * SPREAD)


@kernel
def line_search(
    x: FloatArray, f: float, slope: float, problem: Problem, work: Workspace, counts: IntArray
) -> tuple[float, bool]:
    """Nonmonotone search along `direction`: (f at `trial`, whether it is accepted)."""
    direction, history = work.vectors[DIRECTION], work.history
    trial, trial_gradient = work.vectors[TRIAL], work.vectors[TRIAL_GRADIENT]
    reference = history[0]
    for c in range(1, MEMORY):
        reference = max(reference, history[c])
    length, trial_f = 1.0, f
    for _ in range(TRIALS):
        for c in range(x.size):
            trial[c] = x[c] + length * direction[c]
        trial_f = evaluate(problem, trial, trial_gradient)
        counts[1] += 1
        if trial_f <= reference + SUFFICIENT * length * slope:
            return trial_f, True
        quadratic = -0.5 * length * length * slope / (trial_f - f - length * slope)
        if not 0.1 * length <= quadratic <= 0.9 * length:
            quadratic = 0.5 * length
        length = quadratic
    return trial_f, False


@kernel
def minimise(
    x: FloatArray,
    problem: Problem,
    tolerance: float,
    max_iter: int,
    work: Workspace,
    counts: IntArray,
) -> tuple[float, int]:
    """Improve the feasible point `x` in place: (f, outcome); counts iterations and evaluations."""
    gradient, direction = work.vectors[GRADIENT], work.vectors[DIRECTION]
    trial, trial_gradient = work.vectors[TRIAL], work.vectors[TRIAL_GRADIENT]
    step_sizes, history, sets = work.step_sizes, work.history, problem.sets
    metric = problem.scale[0] * problem.scale[0] / problem.scale[1]
    f = evaluate(problem, x, gradient)
    counts[1] += 1
    history[:] = f
    step_sizes[:] = metric
    patience, waited, few = PATIENCE, 0, step_sizes.size < LARGE_SWARM
    for iteration in range(max_iter + 1):  # the first only determines the first step size
        slope = projected_step(x, gradient, step_sizes, sets, direction)
        if not (math.isfinite(f) and math.isfinite(slope)):
            return f, NOT_FINITE
        if converged(x, problem, work, tolerance):
            return f, CONVERGED
        if iteration == 0:  # no curvature is known yet: a step of about one unit
            step_sizes[:] = metric * problem.scale[0] / longest_displacement(direction)
            continue
        counts[0] += 1
        trial_f, accepted = f, False
        if waited >= patience:
            trial_f, accepted, convex = newton_step(x, f, problem, work, counts)
            patience = patience if accepted else 2 * patience
            waited = waited if convex or (accepted and few) else 0
        if not accepted:
            waited += 1
            trial_f, accepted = line_search(x, f, slope, problem, work, counts)
        if not accepted:
            return f, STALLED
        for c in range(x.size):
            direction[c] = trial[c] - x[c]
            trial[c] = trial_gradient[c] - gradient[c]
            x[c] += direction[c]
            gradient[c] = trial_gradient[c]
        f = trial_f
        history[iteration % MEMORY] = f
        spectral_steps(direction, trial, metric, step_sizes)
    return f, EXHAUSTED


@kernel
def verify(x: FloatArray, problem: Problem, work: Workspace, verified: FloatArray) -> float:
    """Write objective, violation and stationarity of a point, from the problem alone.

    Stationarity is the largest component of x - P(x - gradient) in units of x and f. Returns the
    length of the longest member's part, which `minimise` compares with its tolerance.
    """
    gradient, residual = work.vectors[GRADIENT], work.vectors[DIRECTION]
    f = evaluate(problem, x, gradient)
    verified[0], verified[1], verified[2] = f, 0.0, math.nan
    for i in range(problem.sets.shape[0]):
        distance = violation(x[2 * i], x[2 * i + 1], problem.sets, i)
        if not distance <= verified[1]:
            verified[1] = distance
    if not (math.isfinite(f) and math.isfinite(verified[1])):
        verified[1] = math.inf
        return math.nan
    for c in range(x.size):
        if not math.isfinite(gradient[c]):
            return math.nan  # which a projection onto a box would hide
    work.step_sizes[:] = problem.scale[0] * problem.scale[0] / problem.scale[1]
    projected_step(x, gradient, work.step_sizes, problem.sets, residual)
    verified[2] = largest_component(residual) / problem.scale[0]
    longest: float = longest_displacement(residual) / problem.scale[0]
    return longest


@allocating_kernel
def workspace(members: int) -> Workspace:
    """Arrays for problems of so many members."""
    return Workspace(
        np.empty((8, 2 * members)),
        np.empty(members),
        np.empty(MEMORY),
        np.empty((members, 4)),
        np.zeros(5 * members),
    )


class Method(NamedTuple):
    """Options of `SpectralProjectedGradient`, with the displacements of starts (`Starts`).

    Or, with a step above 0, of `ProjectedGradient`.
    """

    initial: int
    directions: FloatArray
    tolerance: float
    max_iter: int
    step: float = 0.0


@kernel
def descend(
    x: FloatArray, problem: Problem, method: Method, work: Workspace, counts: IntArray
) -> int:
    """Replace the feasible point `x` by P(x - step grad f(x)) `max_iter` times; the outcome.

    Stops where no component moves by more than `tolerance` times the step. Where a step is not
    finite, nor is `x`.
    """
    gradient, following = work.vectors[GRADIENT], work.vectors[TRIAL]
    for _ in range(method.max_iter):
        evaluate(problem, x, gradient)
        counts[0] += 1
        counts[1] += 1
        moved = 0.0
        for c in range(x.size):
            following[c] = x[c] - method.step * gradient[c]
            if not math.isfinite(following[c]):
                x[:] = math.nan
                return NOT_FINITE
        project(following, problem.sets, following)
        for c in range(x.size):
            moved = max(moved, abs(following[c] - x[c]))
        copy(following, x)
        if moved <= method.tolerance * method.step:
            return CONVERGED
    return EXHAUSTED

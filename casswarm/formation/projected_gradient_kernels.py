"""The projected gradient method with a constant step, state by state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import FloatArray, IntArray
from .face_kernels import GRADIENT, TRIAL, Problem, Workspace, copy, evaluate
from .search_kernels import Batch, project, verify, workspace
from .spectral_kernels import CONVERGED, EXHAUSTED, NOT_FINITE, Results


@kernel
def descend(
    x: FloatArray,
    problem: Problem,
    step: float,
    tolerance: float,
    max_iter: int,
    work: Workspace,
    counts: IntArray,
) -> int:
    """Replace the feasible point `x` by P(x - step grad f(x)) `max_iter` times; the outcome.

    Stops where no component moves by more than `tolerance` times the step. Where a step is not
    finite, nor is `x`.
    """
    gradient, following = work.vectors[GRADIENT], work.vectors[TRIAL]
    for _ in range(max_iter):
        evaluate(problem, x, gradient)
        counts[0] += 1
        counts[1] += 1
        moved = 0.0
        for c in range(x.size):
            following[c] = x[c] - step * gradient[c]
            if not math.isfinite(following[c]):
                x[:] = math.nan
                return NOT_FINITE
        project(following, problem.sets, following)
        for c in range(x.size):
            moved = max(moved, abs(following[c] - x[c]))
        copy(following, x)
        if moved <= tolerance * step:
            return CONVERGED
    return EXHAUSTED


@allocating_kernel
def descend_batch(
    rows: tuple[int, int],
    evaluate: Any,
    batch: Batch,
    step: float,
    tolerance: float,
    max_iter: int,
    results: Results,
) -> None:
    """Run the method for the states ``rows[0]`` to ``rows[1] - 1`` and verify the answers."""
    members = batch.sets.shape[1]
    work, scratch = workspace(members), np.empty(members * (members + 8))
    x = np.empty(2 * members)
    for row in range(rows[0], rows[1]):
        problem = Problem(
            evaluate, batch.p[row], batch.constants, batch.sets[row], batch.scale[row], scratch
        )
        project(batch.x0[row], problem.sets, x)
        results.outcome[row] = descend(
            x, problem, step, tolerance, max_iter, work, results.counts[row]
        )
        copy(x, results.x[row])
        verify(x, problem, work, results.verified[row])

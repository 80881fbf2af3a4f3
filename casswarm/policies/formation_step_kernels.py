"""A step of the formation policies in one pass: state in, verified velocities out.

For every state: its problem and scale, the solution by the spectral projected gradient, and the
verification. What `casswarm.policies.formation` otherwise does in arrays, for any solver.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .._util.jit import allocating_kernel, kernel
from ..optimization.feasible_sets.planar_kernels import projected
from ..optimization.solvers.batch.face_newton_kernels import Problem, copy
from ..optimization.solvers.batch.spg_batch_kernels import Method, scratch_for, solve
from ..problems.formation_state_kernels import (
    StateProblem,
    States,
    Terms,
    isolated_rate,
    state_problem,
)
from ..typing import BoolArray, FloatArray, IntArray


class Limits(NamedTuple):
    """Residuals up to which an answer is accepted."""

    violation: float
    stationarity: float


class StepResults(NamedTuple):
    """What is written for B states.

    Parameters
    ----------
    velocities : (B, n, 2)
    verified : (B, 3)
        Objective, violation and stationarity, as of the batch solver's `Results`.
    infeasible : (B,) int
        Members that cannot meet their soft constraint.
    accepted : (B,) bool
        Whether the residuals are within their limits. Where not, nothing else counts.
    """

    velocities: FloatArray
    verified: FloatArray
    infeasible: IntArray
    accepted: BoolArray


@kernel
def write_velocities(x: FloatArray, sets: FloatArray, velocities: FloatArray) -> bool:
    """Write the nearest velocities in the sets, where hard constraints hold; False without any."""
    complete = True
    for i in range(sets.shape[0]):
        velocities[i, 0], velocities[i, 1], exists = projected(x[2 * i], x[2 * i + 1], sets, i)
        complete = complete and exists
    return complete


@allocating_kernel
def decide_states(
    rows: tuple[int, int],
    evaluate: Any,
    constants: FloatArray,
    states: States,
    terms: Terms,
    method: Method,
    limits: Limits,
    results: StepResults,
) -> None:
    """Decide in the states ``rows[0]`` to ``rows[1] - 1``."""
    n = states.alive.shape[1]
    scratch, counts = scratch_for(n, method), np.zeros(2, np.int64)
    own = StateProblem(
        np.empty(6 * n + 4),
        np.empty(2 * n),
        np.empty((n, 10)),
        np.empty(n, np.bool_),
        np.empty(n, np.bool_),
    )
    scale, vectors, numbers = np.empty(2), np.empty((2, 2 * n)), np.empty(n * (n + 8))
    problem = Problem(evaluate, own.p, constants, own.sets, scale, numbers)
    for row in range(rows[0], rows[1]):
        verified = results.verified[row]
        results.accepted[row] = False
        if not state_problem(states, row, terms, own):
            continue
        rate = isolated_rate(evaluate, own.p, states.alive[row], constants, vectors, numbers)
        if not 0.0 <= rate < math.inf:
            continue
        scale[0], scale[1] = terms.v_max, rate if rate > 0.0 else 1.0
        infeasible = 0
        for i in range(n):
            infeasible += own.infeasible[i]
        copy(own.guess, scratch.best)
        solve(own.guess, problem, method, scratch, verified, counts)
        results.infeasible[row] = infeasible
        if verified[1] <= limits.violation and verified[2] <= limits.stationarity:
            results.accepted[row] = write_velocities(
                scratch.best, own.sets, results.velocities[row]
            )

"""A step of the formation policies in one pass: state in, verified velocities out.

For every state: its problem, its scale, the solution by the spectral projected gradient, and the
verification. What `casswarm.policies.formation` otherwise does in arrays, for any solver.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .._util.jit import allocating_kernel, kernel
from ..optimization.feasible_sets.planar_kernels import projected
from ..optimization.solvers.batch.face_newton_kernels import GRADIENT, STEP, Problem, evaluate
from ..optimization.solvers.batch.spg_batch_kernels import Method, Scratch, scratch_for, solve
from ..problems.formation_state_kernels import StateProblem, States, Terms, state_problem
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
def write_scale(problem: Problem, terms: Terms, scratch: Scratch) -> bool:
    """Write v_max, and the rate of isolated members at the present positions; False for no rate.

    The objective itself with nobody alive and velocities of 0: no member has neighbours.
    """
    p, zeros = problem.p, scratch.work.vectors[STEP]
    n = zeros.size // 2
    zeros[:] = 0.0
    p[4 * n : 5 * n] = 0.0
    isolated = evaluate(problem, zeros, scratch.work.vectors[GRADIENT])
    problem.scale[0], problem.scale[1] = terms.v_max, isolated if isolated > 0.0 else 1.0
    return 0.0 <= isolated < math.inf


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
    numbers = np.empty(n * (n + 8))
    problem = Problem(evaluate, own.p, constants, own.sets, np.empty(2), numbers)
    for row in range(rows[0], rows[1]):
        verified = results.verified[row]
        results.accepted[row] = False
        if not state_problem(states, row, terms, own):
            continue
        if not write_scale(problem, terms, scratch):
            continue
        infeasible = 0
        for i in range(n):
            own.p[4 * n + i] = states.alive[row, i]
            infeasible += own.infeasible[i]
        solve(own.guess, problem, method, scratch, verified, counts)
        results.infeasible[row] = infeasible
        if verified[1] <= limits.violation and verified[2] <= limits.stationarity:
            results.accepted[row] = write_velocities(
                scratch.best, own.sets, results.velocities[row]
            )

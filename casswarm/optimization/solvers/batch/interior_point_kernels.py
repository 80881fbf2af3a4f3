"""A primal-dual interior-point method for trajectories within limits, one state at a time.

Minimise the sum over steps s of evaluate(u_s; p_s), where u_s (2n,) are the displacements of all n
members, strictly within the limits of `casswarm.optimization.feasible_sets.trajectory_kernels`. The
Newton step of the primal-dual equations, condensed to a banded matrix, is shortened until no slack
shrinks too much and the barrier function decreases. ``docs/mpc.md``: its second-order correction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...._util.jit import allocating_kernel, kernel
from ....typing import FloatArray, IntArray
from ...feasible_sets.trajectory_kernels import (
    add_jacobian_transpose,
    jacobian_product,
    max_step_length,
    second_order_terms,
    slacks,
    solve,
)
from .face_newton_kernels import copy, largest_component
from .newton_system_kernels import (
    Problem,
    Workspace,
    assemble,
    clear,
    gather,
    newton_direction,
    total,
    workspace,
)
from .outcome_kernels import CONVERGED, EXHAUSTED, NO_INTERIOR, NOT_FINITE, STALLED

SUFFICIENT = 1e-4  # sufficient decrease, as a fraction of what the slope predicts
TRIALS = 40  # of a step's length


class Options(NamedTuple):
    """The barrier parameter and the tolerance at the end."""

    mu_final: float
    tolerance: float
    max_iter: int


@kernel
def barrier(value: float, slack: FloatArray, mu: float) -> float:
    """The barrier function."""
    for row in range(slack.size):
        if slack[row] < math.inf:
            value -= mu * math.log(slack[row])
    return value


@kernel
def largest_shrinkage(slack: FloatArray, trial_slack: FloatArray) -> float:
    """Largest fraction that a slack loses; 2 where one is not a number."""
    largest = 0.0
    for row in range(slack.size):
        if slack[row] < math.inf:
            lost = 1.0 - trial_slack[row] / slack[row]
            largest = max(largest, lost if lost <= 2.0 else 2.0)
    return largest


@kernel
def residuals(
    lagrangian: FloatArray, z: FloatArray, slack: FloatArray, mu: float
) -> tuple[float, float]:
    """Largest components of the Lagrangian's gradient, and of z slack - mu."""
    complementarity = 0.0
    for row in range(z.size):
        if slack[row] < math.inf:
            complementarity = max(complementarity, abs(z[row] * slack[row] - mu))
    return largest_component(lagrangian), complementarity


@kernel
def next_mu(mu: float, z: FloatArray, options: Options, work: Workspace) -> tuple[float, bool]:
    """Reduce the barrier parameter where its equations are solved: (mu, whether converged).

    `residual` holds the Lagrangian's gradient.
    """
    stationarity, complementarity = residuals(work.residual, z, work.slack, mu)
    while (
        mu > options.mu_final
        and stationarity <= max(10.0 * mu, options.tolerance)
        and complementarity <= 10.0 * mu
    ):
        mu = max(options.mu_final, min(0.2 * mu, mu**1.5))
        complementarity = residuals(work.residual, z, work.slack, mu)[1]
    converged = (
        mu <= options.mu_final
        and stationarity <= options.tolerance
        and complementarity <= 10.0 * mu
    )
    return mu, converged


@kernel
def correct(
    y: FloatArray, z: FloatArray, fraction: float, problem: Problem, work: Workspace
) -> None:
    """Write the second-order correction of the step, zero where the limits do not cut it."""
    clear(work.correction)
    if max_step_length(y, work.step, fraction, work.slack, problem.constraints) < 1.0:
        second_order_terms(work.step, problem.constraints, work.rows)
        for row in range(z.size):
            work.rows[row] *= z[row] / work.slack[row]
        add_jacobian_transpose(y, work.rows, problem.constraints, work.correction)
        for c in range(y.size):
            work.correction[c] = -work.correction[c]
        solve(work.factor, work.correction)


@kernel
def line_search(
    y: FloatArray, value: float, mu: float, problem: Problem, work: Workspace, counts: IntArray
) -> tuple[float, bool]:
    """Search along the corrected step: (objective at `trial`, whether it is accepted)."""
    slope = 0.0
    for c in range(y.size):
        slope += work.residual[c] * work.step[c]
    reference, fraction, length = barrier(value, work.slack, mu), max(0.99, 1.0 - mu), 1.0
    for _ in range(TRIALS):
        for c in range(y.size):
            work.trial[c] = y[c] + length * (work.step[c] + length * work.correction[c])
        slacks(work.trial, problem.constraints, work.trial_slack)
        if largest_shrinkage(work.slack, work.trial_slack) <= fraction:
            trial_value = total(work.trial, problem)
            counts[1] += 1
            merit = barrier(trial_value, work.trial_slack, mu)
            if merit <= reference + SUFFICIENT * length * slope + 2.0**-46 * abs(reference):
                return trial_value, True
        length *= 0.6
    total(y, problem)  # so that `u` is that of y
    return value, False


@kernel
def move_multipliers(z: FloatArray, mu: float, work: Workspace) -> None:
    """The Newton step of the multipliers, as far as they stay positive, and near mu / slack.

    `rows` holds J times the step.
    """
    slack, rows = work.slack, work.rows
    fraction, length = max(0.99, 1.0 - mu), 1.0
    for row in range(z.size):
        if slack[row] < math.inf:
            dz = (mu + z[row] * rows[row]) / slack[row] - z[row]
            if dz < 0.0 and -length * dz > fraction * z[row]:
                length = -fraction * z[row] / dz
    for row in range(z.size):
        if slack[row] < math.inf:
            dz = (mu + z[row] * rows[row]) / slack[row] - z[row]
            ideal = mu / work.trial_slack[row]
            z[row] = min(max(z[row] + length * dz, 1e-10 * ideal), 1e10 * ideal)
        else:
            z[row] = 0.0


@allocating_kernel
def minimise(
    y: FloatArray, z: FloatArray, mu: float, problem: Problem, options: Options, counts: IntArray
) -> tuple[float, int]:
    """Improve `y`, strictly inside, in place, with multipliers z: (value, outcome).

    `mu` is the initial barrier parameter. Multipliers that are 0 begin at mu / slack; counts
    iterations and evaluations.
    """
    work, regularisation = workspace(problem), 0.0
    if not slacks(y, problem.constraints, work.slack) > 0.0:
        return math.nan, NO_INTERIOR
    for row in range(z.size):
        if z[row] == 0.0:
            z[row] = mu / work.slack[row]
    value = total(y, problem)
    counts[1] += 1
    for _ in range(options.max_iter):
        gather(problem, work.gradient)
        copy(work.gradient, work.residual)
        add_jacobian_transpose(y, z, problem.constraints, work.residual)
        if not (
            math.isfinite(value) and math.isfinite(residuals(work.residual, z, work.slack, 0.0)[0])
        ):
            return value, NOT_FINITE
        mu, converged = next_mu(mu, z, options, work)
        if converged:
            return value, CONVERGED
        assemble(y, z, mu, problem, work)
        counts[1] += problem.columns.size
        regularisation = newton_direction(work, regularisation)
        if regularisation < 0.0:
            return value, NOT_FINITE
        counts[0] += 1
        correct(y, z, max(0.99, 1.0 - mu), problem, work)
        trial_value, accepted = line_search(y, value, mu, problem, work, counts)
        if not accepted:
            return value, STALLED
        jacobian_product(y, work.step, problem.constraints, work.rows)
        move_multipliers(z, mu, work)
        copy(work.trial, y)
        copy(work.trial_slack, work.slack)
        value = trial_value
    return value, EXHAUSTED

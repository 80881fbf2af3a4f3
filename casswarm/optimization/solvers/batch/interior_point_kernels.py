"""A primal-dual interior-point method for trajectories within limits, one state at a time.

Minimise the sum over steps s of evaluate(u_s; p_s) over trajectories u within the limits of
`casswarm.optimization.feasible_sets.trajectory_kernels`, where u_s (2n,) are the displacements of
all n members. The limits are convex and have an interior, and every iterate is strictly within
them. A step is the Newton step of the primal-dual equations, condensed to a banded matrix, and
shortened until no slack shrinks too much and the barrier function decreases. Where the limits cut
it, a second-order correction follows the curvature of their discs first, with the same factor;
without it, iterates zigzag between thin slivers of discs. Where the matrix is not positive
definite, a multiple of the identity is added.

A step's block of the objective's Hessian is taken from differences of gradients: the displacements
of a step enter no other step's objective.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...._util.jit import allocating_kernel, kernel
from ....typing import FloatArray, IntArray
from ...feasible_sets.trajectory_kernels import (
    Constraints,
    add_curvature,
    add_jacobian_transpose,
    factor,
    jacobian_product,
    max_step_length,
    second_order_terms,
    slacks,
    solve,
)
from .engine import CONVERGED, EXHAUSTED, NO_INTERIOR, NOT_FINITE, STALLED

DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
SUFFICIENT = 1e-4  # sufficient decrease, as a fraction of what the slope predicts
TRIALS = 40  # of a step's length
REGULARISATIONS = 30  # attempts to make the Newton matrix positive definite


class Objective(NamedTuple):
    """A state's objective as a function of the displacements y of its active members.

    Parameters
    ----------
    evaluate : objective
        See `casswarm._util.jit.objective`.
    p : (1 or H, np)
        Parameters, for all steps or for each.
    constants : vector
    scale : (2,)
        Units of x and of the objective.
    active : (k,) int
        Members whose trajectories are variables.
    u, gradients : (H, 2n)
        Displacements of all members at the last y, and the gradients there.
    scratch : vector
        Overwritten by `evaluate`.
    """

    evaluate: Any
    p: FloatArray
    constants: FloatArray
    scale: FloatArray
    active: IntArray
    u: FloatArray
    gradients: FloatArray
    scratch: FloatArray


class Schedule(NamedTuple):
    """The barrier parameter, from `mu_init` to `mu_final`; the tolerance at the end."""

    mu_init: float
    mu_final: float
    tolerance: float
    max_iter: int


class Workspace(NamedTuple):
    """Vectors of slacks (6 k H,) and variables (2 k H,), Newton matrices, and a gradient (2n,)."""

    slack: FloatArray
    trial_slack: FloatArray
    rows: FloatArray
    gradient: FloatArray
    residual: FloatArray
    step: FloatArray
    correction: FloatArray
    trial: FloatArray
    band: FloatArray
    saved_band: FloatArray
    block: FloatArray
    changed: FloatArray


@kernel
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy without slices, whose error messages take Numba seconds to compile."""
    for c in range(source.size):
        target[c] = source[c]


@kernel
def copy_matrix(source: FloatArray, target: FloatArray) -> None:
    """Copy a matrix without slices."""
    for r in range(source.shape[0]):
        for c in range(source.shape[1]):
            target[r, c] = source[r, c]


@kernel
def clear(target: FloatArray) -> None:
    """Write zeros."""
    for c in range(target.size):
        target[c] = 0.0


@kernel
def total(y: FloatArray, objective: Objective) -> float:
    """Objective at y, in its unit; `u` and `gradients` are written."""
    u, p, active, scale = objective.u, objective.p, objective.active, objective.scale
    members, value = active.size, 0.0
    for s in range(u.shape[0]):
        for a in range(members):
            c = 2 * (s * members + a)
            u[s, 2 * active[a]] = scale[0] * y[c]
            u[s, 2 * active[a] + 1] = scale[0] * y[c + 1]
        value += objective.evaluate(
            u[s],
            p[min(s, p.shape[0] - 1)],
            objective.constants,
            objective.gradients[s],
            objective.scratch,
        )
    return value / scale[1]  # type: ignore[no-any-return]


@kernel
def gather(objective: Objective, out: FloatArray) -> None:
    """Write the gradient with respect to y, in units."""
    active, scale = objective.active, objective.scale
    for s in range(objective.gradients.shape[0]):
        for a in range(active.size):
            for axis in range(2):
                derivative = objective.gradients[s, 2 * active[a] + axis]
                out[2 * (s * active.size + a) + axis] = derivative * scale[0] / scale[1]


@kernel
def add_hessian(objective: Objective, work: Workspace) -> None:
    """Add the objective's Hessian, in units, to the band; `block` and `changed` are overwritten."""
    u, p, active, scale = objective.u, objective.p, objective.active, objective.scale
    gradients, band, block, changed = objective.gradients, work.band, work.block, work.changed
    size, last = 2 * active.size, band.shape[1] - 1
    length = DIFFERENCE * scale[0]
    unit = scale[0] * scale[0] / (scale[1] * length)
    for s in range(u.shape[0]):
        for c in range(size):
            column = 2 * active[c // 2] + c % 2
            original = u[s, column]
            u[s, column] = original + length
            objective.evaluate(
                u[s],
                p[min(s, p.shape[0] - 1)],
                objective.constants,
                changed,
                objective.scratch,
            )
            u[s, column] = original
            for r in range(size):
                row = 2 * active[r // 2] + r % 2
                block[r, c] = (changed[row] - gradients[s, row]) * unit
        for r in range(size):
            for c in range(r + 1):
                band[s * size + r, last + c - r] += 0.5 * (block[r, c] + block[c, r])


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
    stationarity, complementarity = 0.0, 0.0
    for c in range(lagrangian.size):
        stationarity = max(stationarity, abs(lagrangian[c]))
    for row in range(z.size):
        if slack[row] < math.inf:
            complementarity = max(complementarity, abs(z[row] * slack[row] - mu))
    return stationarity, complementarity


@kernel
def newton_direction(work: Workspace, regularisation: float) -> float:
    """Write the Newton step; return the regularisation that it needed, negative for failure."""
    band, step, diagonal = work.band, work.step, work.band.shape[1] - 1
    largest = 0.0
    for r in range(band.shape[0]):
        largest = max(largest, abs(band[r, diagonal]))
    copy_matrix(band, work.saved_band)
    added = 0.0
    for _ in range(REGULARISATIONS):
        if factor(band):
            for c in range(step.size):
                step[c] = -work.residual[c]
            solve(band, step)
            return added
        added = max(regularisation / 3.0, 2.0**-48 * largest, 1e-8) if added == 0.0 else 8.0 * added
        copy_matrix(work.saved_band, band)
        for r in range(band.shape[0]):
            band[r, diagonal] += added
    return -1.0


@allocating_kernel
def workspace(members: int, steps: int, n: int) -> Workspace:
    """Arrays for problems of k of n members over H steps."""
    size = 2 * members * steps
    slack, vectors = np.empty((3, 3 * size)), np.empty((5, size))
    band = np.empty((2, size, 4 * members + 2))
    return Workspace(
        slack[0],
        slack[1],
        slack[2],
        vectors[0],
        vectors[1],
        vectors[2],
        vectors[3],
        vectors[4],
        band[0],
        band[1],
        np.empty((2 * members, 2 * members)),
        np.empty(2 * n),
    )


@kernel
def next_mu(mu: float, z: FloatArray, schedule: Schedule, work: Workspace) -> tuple[float, bool]:
    """Reduce the barrier parameter where its equations are solved: (mu, whether converged).

    `residual` holds the Lagrangian's gradient.
    """
    stationarity, complementarity = residuals(work.residual, z, work.slack, mu)
    while (
        mu > schedule.mu_final
        and stationarity <= max(10.0 * mu, schedule.tolerance)
        and complementarity <= 10.0 * mu
    ):
        mu = max(schedule.mu_final, min(0.2 * mu, mu**1.5))
        complementarity = residuals(work.residual, z, work.slack, mu)[1]
    converged = (
        mu <= schedule.mu_final
        and stationarity <= schedule.tolerance
        and complementarity <= 10.0 * mu
    )
    return mu, converged


@kernel
def assemble(
    y: FloatArray,
    z: FloatArray,
    mu: float,
    objective: Objective,
    constraints: Constraints,
    work: Workspace,
) -> None:
    """Write the condensed Newton equations: the matrix `band` and the right side `residual`."""
    for row in range(z.size):
        work.rows[row] = mu / work.slack[row]
    copy(work.gradient, work.residual)
    add_jacobian_transpose(y, work.rows, constraints, work.residual)
    for r in range(work.band.shape[0]):
        clear(work.band[r])
    add_hessian(objective, work)
    add_curvature(y, z, work.slack, constraints, work.band)


@kernel
def correct(
    y: FloatArray, z: FloatArray, fraction: float, constraints: Constraints, work: Workspace
) -> None:
    """Write the second-order correction of the step, zero where the limits do not cut it."""
    clear(work.correction)
    if max_step_length(y, work.step, fraction, work.slack, constraints) < 1.0:
        members, steps = constraints.radii.shape
        second_order_terms(work.step, members, steps, work.rows)
        for row in range(z.size):
            work.rows[row] *= z[row] / work.slack[row]
        add_jacobian_transpose(y, work.rows, constraints, work.correction)
        for c in range(y.size):
            work.correction[c] = -work.correction[c]
        solve(work.band, work.correction)


@kernel
def line_search(
    y: FloatArray,
    value: float,
    mu: float,
    objective: Objective,
    constraints: Constraints,
    work: Workspace,
    counts: IntArray,
) -> tuple[float, bool]:
    """Search along the corrected step: (objective at `trial`, whether it is accepted)."""
    slope = 0.0
    for c in range(y.size):
        slope += work.residual[c] * work.step[c]
    reference, fraction, length = barrier(value, work.slack, mu), max(0.99, 1.0 - mu), 1.0
    for _ in range(TRIALS):
        for c in range(y.size):
            work.trial[c] = y[c] + length * (work.step[c] + length * work.correction[c])
        slacks(work.trial, constraints, work.trial_slack)
        if largest_shrinkage(work.slack, work.trial_slack) <= fraction:
            trial_value = total(work.trial, objective)
            counts[1] += 1
            merit = barrier(trial_value, work.trial_slack, mu)
            if merit <= reference + SUFFICIENT * length * slope + 2.0**-46 * abs(reference):
                return trial_value, True
        length *= 0.6
    total(y, objective)  # so that `u` is that of y
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
    y: FloatArray,
    z: FloatArray,
    objective: Objective,
    constraints: Constraints,
    schedule: Schedule,
    counts: IntArray,
) -> tuple[float, int]:
    """Improve `y`, strictly inside, in place, with multipliers z: (value, outcome).

    Multipliers that are 0 begin at mu / slack; counts iterations and evaluations.
    """
    members, steps = constraints.radii.shape
    work = workspace(members, steps, objective.u.shape[1] // 2)
    mu, regularisation = schedule.mu_init, 0.0
    if not slacks(y, constraints, work.slack) > 0.0:
        return math.nan, NO_INTERIOR
    for row in range(z.size):
        if z[row] == 0.0:
            z[row] = mu / work.slack[row]
    value = total(y, objective)
    counts[1] += 1
    for _ in range(schedule.max_iter):
        gather(objective, work.gradient)
        copy(work.gradient, work.residual)
        add_jacobian_transpose(y, z, constraints, work.residual)
        if not (
            math.isfinite(value) and math.isfinite(residuals(work.residual, z, work.slack, 0.0)[0])
        ):
            return value, NOT_FINITE
        mu, converged = next_mu(mu, z, schedule, work)
        if converged:
            return value, CONVERGED
        assemble(y, z, mu, objective, constraints, work)
        counts[1] += 2 * members
        regularisation = newton_direction(work, regularisation)
        if regularisation < 0.0:
            return value, NOT_FINITE
        counts[0] += 1
        correct(y, z, max(0.99, 1.0 - mu), constraints, work)
        trial_value, accepted = line_search(y, value, mu, objective, constraints, work, counts)
        if not accepted:
            return value, STALLED
        jacobian_product(y, work.step, constraints, work.rows)
        move_multipliers(z, mu, work)
        copy(work.trial, y)
        copy(work.trial_slack, work.slack)
        value = trial_value
    return value, EXHAUSTED

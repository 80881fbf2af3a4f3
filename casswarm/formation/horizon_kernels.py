"""An interior-point method for trajectories within limits, state by state and over batches.

Minimise the sum over steps s of evaluate(u_s; p_s), where u_s (2n,) are the displacements of all n
members, strictly within the limits of `casswarm.formation.trajectory_kernels`. The Newton step of
the primal-dual equations, condensed to a banded matrix, is shortened until no slack shrinks too
much and the barrier function decreases. ``docs/mpc.md``: its second-order correction.

A step's block of the objective's Hessian is taken from differences of gradients: the displacements
of a step enter no other step's objective.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..solvers.interior_point.iterate_kernels import KEEP, is_solved, move_multipliers, smaller_mu
from ..typing import BoolArray, FloatArray, IntArray
from .face_kernels import copy, largest_component
from .spectral_kernels import (
    CONVERGED,
    EXHAUSTED,
    NO_INTERIOR,
    NOT_FINITE,
    STALLED,
    Results,
    Starts,
    count_hits,
    needs_start,
    write_start,
)
from .trajectory_kernels import (
    ROWS,
    Constraints,
    add_curvature,
    add_jacobian_transpose,
    factor,
    max_step_length,
    second_order_terms,
    slack_changes,
    slacks,
    solve,
)

DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
REGULARISATIONS = 30  # attempts to make the Newton matrix positive definite


class Problem(NamedTuple):
    """A state's problem: the displacements y of its k active members within their limits.

    Fields that are not described are those of `face_kernels.Problem`.

    Parameters
    ----------
    p, constants : (1 or H, np), (1 or H, s)
        Parameters and constants, for all steps or for each.
    columns : (2k,) int
        Columns of `u` that are variables: the coordinates of active members.
    constraints : Constraints
        Limits of y.
    u, gradients : (H, 2n)
        Displacements of all members at the last y, and the gradients there.
    """

    evaluate: Any
    p: FloatArray
    constants: FloatArray
    scale: FloatArray
    columns: IntArray
    constraints: Constraints
    u: FloatArray
    gradients: FloatArray
    scratch: FloatArray


class Workspace(NamedTuple):
    """Vectors of slacks (6 k H,) and variables (2 k H,), Newton matrices, and a gradient (2n,).

    `lane` (3, 1) are the arguments of `move_multipliers` that are numbers.
    """

    slack: FloatArray
    trial_slack: FloatArray
    rows: FloatArray
    gradient: FloatArray
    residual: FloatArray
    step: FloatArray
    correction: FloatArray
    trial: FloatArray
    band: FloatArray
    factor: FloatArray
    block: FloatArray
    changed: FloatArray
    lane: FloatArray


@kernel
def read(u: FloatArray, columns: IntArray, unit: float, y: FloatArray) -> None:
    """Write some columns of u, row by row and in units, to the vector y."""
    for s in range(u.shape[0]):
        for c in range(columns.size):
            y[s * columns.size + c] = u[s, columns[c]] / unit


@kernel
def write(y: FloatArray, problem: Problem) -> None:
    """Write the displacements y to `u`."""
    columns, unit = problem.columns, problem.scale[0]
    for s in range(problem.u.shape[0]):
        for c in range(columns.size):
            problem.u[s, columns[c]] = unit * y[s * columns.size + c]


@kernel
def evaluate(problem: Problem, s: int, gradient: FloatArray) -> float:
    """Objective of step s at `u`; its gradient is written."""
    p = problem.p[min(s, problem.p.shape[0] - 1)]
    constants = problem.constants[min(s, problem.constants.shape[0] - 1)]
    return problem.evaluate(problem.u[s], p, constants, gradient, problem.scratch)  # type: ignore[no-any-return]


@kernel
def total(y: FloatArray, problem: Problem) -> float:
    """Objective at y, in its unit; `u` and `gradients` are written."""
    write(y, problem)
    value, unit = 0.0, float(problem.scale[1])
    for s in range(problem.u.shape[0]):
        value += evaluate(problem, s, problem.gradients[s])
    return value / unit


@kernel
def gather(problem: Problem, out: FloatArray) -> None:
    """Write the gradient with respect to y, in units."""
    columns, scale = problem.columns, problem.scale
    for s in range(problem.gradients.shape[0]):
        for c in range(columns.size):
            derivative = problem.gradients[s, columns[c]]
            out[s * columns.size + c] = derivative * scale[0] / scale[1]


@kernel
def add_hessian(problem: Problem, work: Workspace) -> None:
    """Add the objective's Hessian, in units, to the band; `block` and `changed` are overwritten."""
    u, columns, scale = problem.u, problem.columns, problem.scale
    band, block, size, last = work.band, work.block, columns.size, work.band.shape[1] - 1
    length = DIFFERENCE * scale[0]
    unit = scale[0] * scale[0] / (scale[1] * length)
    for s in range(u.shape[0]):
        for c in range(size):
            original = u[s, columns[c]]
            u[s, columns[c]] = original + length
            evaluate(problem, s, work.changed)
            u[s, columns[c]] = original
            for r in range(size):
                change = work.changed[columns[r]] - problem.gradients[s, columns[r]]
                block[r, c] = change * unit
        for r in range(size):
            for c in range(r + 1):
                band[s * size + r, last + c - r] += 0.5 * (block[r, c] + block[c, r])


@kernel
def newton_direction(work: Workspace, regularisation: float) -> float:
    """Write the Newton step; return the regularisation that it needed, negative for failure."""
    band, step, diagonal = work.band, work.step, work.band.shape[1] - 1
    largest = 0.0
    for r in range(band.shape[0]):
        largest = max(largest, abs(band[r, diagonal]))
    added = 0.0
    for _ in range(REGULARISATIONS):
        if factor(band, added, work.factor):
            for c in range(step.size):
                step[c] = -work.residual[c]
            solve(work.factor, step)
            return added
        added = max(regularisation / 3.0, 2.0**-48 * largest, 1e-8) if added == 0.0 else 8.0 * added
    return -1.0


@allocating_kernel
def workspace(problem: Problem) -> Workspace:
    """Arrays for the trajectories of a problem."""
    steps, block = problem.u.shape[0], problem.columns.size
    slack, vectors = np.empty((3, 3 * block * steps)), np.empty((5, block * steps))
    band = np.empty((2, block * steps, 2 * block + 2))
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
        np.empty((block, block)),
        np.empty(problem.u.shape[1]),
        np.empty((3, 1)),
    )


@kernel
def assemble(y: FloatArray, z: FloatArray, mu: float, problem: Problem, work: Workspace) -> None:
    """Write the condensed Newton equations: the matrix `band` and the right side `residual`."""
    for row in range(z.size):
        work.rows[row] = mu / work.slack[row]
    copy(work.gradient, work.residual)
    add_jacobian_transpose(y, work.rows, problem.constraints, work.residual)
    work.band[:] = 0.0
    add_hessian(problem, work)
    add_curvature(y, z, work.slack, problem.constraints, work.band)


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
    lagrangian: FloatArray, z: FloatArray, slack: FloatArray
) -> tuple[float, float, float, float, float]:
    """Residuals as those of `is_solved`: slacks are exact, and nothing is relative."""
    least, most = math.inf, -math.inf
    for row in range(z.size):
        if slack[row] < math.inf:
            least, most = min(least, z[row] * slack[row]), max(most, z[row] * slack[row])
    return largest_component(lagrangian), least, most, 0.0, 1.0


@kernel
def correct(
    y: FloatArray, z: FloatArray, fraction: float, problem: Problem, work: Workspace
) -> None:
    """Write the second-order correction of the step, zero where the limits do not cut it."""
    work.correction[:] = 0.0
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
    reference, fraction, length = barrier(value, work.slack, mu), 1.0 - min(KEEP, mu), 1.0
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
def move(z: FloatArray, mu: float, work: Workspace) -> None:
    """Move the multipliers with the slacks, whose changes `rows` are overwritten."""
    lane, shape = work.lane, (1, z.size, 1)
    lane[0, 0], lane[1, 0], lane[2, 0] = mu, min(KEEP, mu), 1.0
    gaps = work.slack.reshape(shape), work.trial_slack.reshape(shape)
    step, changes = work.rows.reshape(shape), (work.rows.reshape(shape), lane[2])
    move_multipliers(gaps, lane[0], step[0], lane[1], changes, z.reshape(shape))


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
        errors = residuals(work.residual, z, work.slack)
        if not (math.isfinite(value) and math.isfinite(errors[0])):
            return value, NOT_FINITE
        mu = smaller_mu(mu, errors, options.mu_final, options.tolerance)
        done = mu <= options.mu_final and errors[0] <= options.tolerance
        if done and is_solved(mu, errors, options.tolerance):
            return value, CONVERGED
        assemble(y, z, mu, problem, work)
        counts[1] += problem.columns.size
        regularisation = newton_direction(work, regularisation)
        if regularisation < 0.0:
            return value, NOT_FINITE
        counts[0] += 1
        correct(y, z, 1.0 - min(KEEP, mu), problem, work)
        trial_value, accepted = line_search(y, value, mu, problem, work, counts)
        if not accepted:
            return value, STALLED
        slack_changes(y, work.step, problem.constraints, work.rows)
        move(z, mu, work)
        copy(work.trial, y)
        copy(work.trial_slack, work.slack)
        value = trial_value
    return value, EXHAUSTED


MU_INIT = 1e-2  # barrier parameter at the beginning, in units of the objective
COARSE = 1e-4  # barrier parameter at which starts are compared, in units of the objective
MARGIN = 0.1  # fraction of every slack that a start keeps


class Batch(NamedTuple):
    """B states of n members over H steps: `TrajectorySets`, coordinates of members as one axis.

    x0, the initial guesses, (B, H, 2n), inside (B, H, 2n), free (B, n), initial_velocities
    (B, 1, 2n), centers (B, H, 2n), radii (B, H, n), p (B, 1 or H, np), constants (1 or H, s);
    scale (B, 2) are the units of x, the bound of a velocity's components, and of the objective.
    """

    x0: FloatArray
    inside: FloatArray
    free: BoolArray
    initial_velocities: FloatArray
    change: float
    centers: FloatArray
    radii: FloatArray
    p: FloatArray
    constants: FloatArray
    scale: FloatArray


@allocating_kernel
def scaled_constraints(batch: Batch, row: int, members: IntArray, columns: IntArray) -> Constraints:
    """Constraints of some members, and so of some columns, in units of x."""
    unit, steps = batch.scale[row, 0], batch.radii.shape[1]
    constraints = Constraints(
        np.empty(columns.size),
        (batch.change / unit) ** 2,
        np.empty(steps * columns.size),
        np.empty(steps * members.size),
    )
    read(batch.initial_velocities[row], columns, unit, constraints.initial_velocities)
    read(batch.centers[row], columns, unit, constraints.centers)
    read(batch.radii[row], members, unit, constraints.radii)
    for m in range(constraints.radii.size):
        constraints.radii[m] *= constraints.radii[m]
    return constraints


@allocating_kernel
def move_inside(inside: FloatArray, guess: FloatArray, constraints: Constraints) -> None:
    """Move every member's trajectory in `guess` towards `inside` until it has a margin.

    The limits are a product over members: one that can move little does not restrict the others.
    """
    members = constraints.initial_velocities.size // 2
    slack, step = np.empty(3 * guess.size), np.empty(guess.size)
    slacks(inside, constraints, slack)
    for a in range(members):
        for c in range(guess.size):
            step[c] = guess[c] - inside[c] if c // 2 % members == a else 0.0
        length = max_step_length(inside, step, 1.0 - MARGIN, slack, constraints)
        for c in range(guess.size):
            if c // 2 % members == a:
                guess[c] = inside[c] + length * step[c]


@kernel
def largest_violation(slack: FloatArray, constraints: Constraints) -> float:
    """Largest violation of a constraint as a distance, in units."""
    violation = 0.0
    for row in range(slack.size):
        if slack[row] < 0.0:
            bound = 0.0
            if row % ROWS == 4:
                bound = math.sqrt(constraints.acceleration)
            elif row % ROWS == 5:
                bound = math.sqrt(constraints.radii[row // ROWS])
            out = math.sqrt(bound * bound - slack[row]) - bound if row % ROWS > 3 else -slack[row]
            violation = max(violation, out)
    return violation


@allocating_kernel
def verify(z: FloatArray, problem: Problem) -> tuple[float, float, float]:
    """Objective, violation and residual of the answer `u`, recomputed from the problem alone.

    The violation is a distance, in units; the residual is the larger of stationarity and
    complementarity.
    """
    slack, y, lagrangian = np.empty(z.size), np.empty(z.size // 3), np.empty(z.size // 3)
    read(problem.u, problem.columns, problem.scale[0], y)
    value = total(y, problem)
    slacks(y, problem.constraints, slack)
    gather(problem, lagrangian)
    add_jacobian_transpose(y, z, problem.constraints, lagrangian)
    violation, least = largest_violation(slack, problem.constraints), 0.0
    for row in range(z.size):
        least = min(least, z[row])
    stationarity, smallest, largest, _, _ = residuals(lagrangian, z, slack)
    if not (math.isfinite(value) and math.isfinite(stationarity)) or least < 0.0:
        return value * problem.scale[1], math.inf, math.nan
    return value * problem.scale[1], violation, max(stationarity, largest, -smallest)


@allocating_kernel
def minimise_state(
    row: int,
    batch: Batch,
    starts: Starts,
    z: FloatArray,
    problem: Problem,
    options: Options,
    counts: IntArray,
) -> int:
    """Solve a state from its starts, with multipliers z; return the outcome.

    `problem.u` begins strictly inside, and ends as the answer.
    """
    columns, unit = problem.columns, problem.scale[0]
    inside, y, best = np.empty(z.size // 3), np.empty(z.size // 3), np.empty(z.size // 3)
    steps, size = batch.x0.shape[1:]
    slack, best_z, start = np.empty(z.size), np.zeros(z.size), np.empty((steps, size))
    read(problem.u, columns, unit, inside)
    copy(inside, best)
    if not slacks(inside, problem.constraints, slack) > 0.0:
        return NO_INTERIOR
    mu_final, tolerance, max_iter = options.mu_final, options.tolerance, options.max_iter
    coarse = Options(max(COARSE, mu_final), max(COARSE, tolerance), max_iter)
    if starts.initial == 1:
        read(batch.x0[row], columns, unit, best)
        move_inside(inside, best, problem.constraints)
    least, hits, solved = math.inf, 0, 0
    while needs_start(solved, hits, starts):
        for s in range(steps):
            write_start(solved, batch.x0[row, s], starts, row, start[s])
        read(start, columns, unit, y)
        move_inside(inside, y, problem.constraints)
        z[:] = 0.0
        value, outcome = minimise(y, z, MU_INIT, problem, coarse, counts)
        if outcome != NOT_FINITE:
            hits = count_hits(value, least, hits)
            if value < least:
                least = value
                copy(y, best)
                copy(z, best_z)
        solved += 1
    mu = max(MU_INIT if math.isinf(least) else COARSE, mu_final)
    copy(best_z, z)
    _value, outcome = minimise(best, z, mu, problem, options, counts)
    write(best, problem)
    return outcome


@allocating_kernel
def minimise_batch(
    rows: tuple[int, int],
    evaluate: Any,
    batch: Batch,
    starts: Starts,
    options: Options,
    multipliers: FloatArray,
    results: Results,
) -> None:
    """Solve the states ``rows[0]`` to ``rows[1] - 1`` and verify the answers.

    Writes x (B, H, 2n) and multipliers (B, H, n, 6).
    """
    steps, n = batch.inside.shape[1], batch.free.shape[1]
    scratch, gradients = np.empty(n * (n + 8)), np.empty((steps, 2 * n))
    for row in range(rows[0], rows[1]):
        members = np.flatnonzero(batch.free[row])
        columns, u = np.flatnonzero(np.repeat(batch.free[row], 2)), results.x[row]
        p, scale = batch.p[row], batch.scale[row]
        constraints = scaled_constraints(batch, row, members, columns)
        problem = Problem(
            evaluate, p, batch.constants, scale, columns, constraints, u, gradients, scratch
        )
        z = np.zeros(ROWS * constraints.radii.size)
        for s in range(steps):
            copy(batch.inside[row, s], u[s])
        results.outcome[row] = minimise_state(
            row, batch, starts, z, problem, options, results.counts[row]
        )
        verified = results.verified[row]
        verified[0], verified[1], verified[2] = verify(z, problem)
        for s in range(steps):
            for a in range(members.size):
                for c in range(ROWS):
                    multipliers[row, s, members[a], c] = z[ROWS * (s * members.size + a) + c]

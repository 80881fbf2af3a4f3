"""Batches of states for the interior-point method: starts, units, verification."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...._util.jit import allocating_kernel, kernel
from ....typing import BoolArray, FloatArray, IntArray
from ...feasible_sets.trajectory_kernels import (
    ROWS,
    Constraints,
    add_jacobian_transpose,
    max_step_length,
    slacks,
)
from .engine import Results
from .face_newton_kernels import copy
from .interior_point_kernels import Options, minimise, residuals
from .multistart_kernels import Starts, count_hits, needs_start, write_start
from .newton_system_kernels import Problem, clear, gather, read, total, write
from .outcome_kernels import NO_INTERIOR, NOT_FINITE

MU_INIT = 1e-2  # barrier parameter at the beginning, in units of the objective
COARSE = 1e-4  # barrier parameter at which starts are compared, in units of the objective
MARGIN = 0.1  # fraction of every slack that a start keeps


class Batch(NamedTuple):
    """B states of n members over H steps: `TrajectorySets`, coordinates of members as one axis.

    x0, the initial guesses, (B, H, 2n), inside (B, H, 2n), free (B, n), initial_velocities
    (B, 1, 2n), centers (B, H, 2n), radii (B, H, n), p (B, 1 or H, np); scale (B, 2) are the units
    of x, the bound of a velocity's components, and of the objective.
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
    stationarity, complementarity = residuals(lagrangian, z, slack, 0.0)
    if not (math.isfinite(value) and math.isfinite(stationarity)) or least < 0.0:
        return value * problem.scale[1], math.inf, math.nan
    return value * problem.scale[1], violation, max(stationarity, complementarity)


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
        clear(z)
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

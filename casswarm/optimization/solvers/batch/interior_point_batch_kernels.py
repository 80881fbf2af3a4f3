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
from .engine import NO_INTERIOR, NOT_FINITE, Results
from .interior_point_kernels import Schedule, minimise, residuals
from .newton_system_kernels import Objective, clear, copy, gather, total

MU_INIT = 1e-2  # barrier parameter at the beginning, in units of the objective
COARSE = 1e-4  # barrier parameter at which starts are compared
MARGIN = 0.1  # fraction of every slack that a start keeps


class Batch(NamedTuple):
    """B states of n members over H steps.

    Parameters
    ----------
    starts : (B, S, H, 2n)
    inside : (B, H, 2n)
        Trajectories strictly within the limits; those of members that are not free are fixed.
    free : (B, n) bool
    initial_velocities : (B, n, 2)
    limits : (2,)
        Bounds of a velocity's components and of its change in a step.
    centers, radii : (B, n, H, 2), (B, n, H)
    p : (B, 1 or H, np)
    constants : vector
    scale : (B, 2)
        Units of x, the first of `limits`, and of the objective.
    """

    starts: FloatArray
    inside: FloatArray
    free: BoolArray
    initial_velocities: FloatArray
    limits: FloatArray
    centers: FloatArray
    radii: FloatArray
    p: FloatArray
    constants: FloatArray
    scale: FloatArray


class Options(NamedTuple):
    """Barrier parameter at the end, tolerance, and the limit of iterations."""

    mu_final: float
    tolerance: float
    max_iter: int


@allocating_kernel
def scaled_constraints(batch: Batch, row: int, active: IntArray) -> Constraints:
    """Constraints of the active members, with velocities in units of their bound."""
    limits, centers, radii = batch.limits, batch.centers[row], batch.radii[row]
    k, steps = active.size, radii.shape[1]
    scaled = Constraints(
        np.empty((k, 2)),
        (limits[1] / limits[0]) ** 2,
        np.empty((k, steps, 2)),
        np.empty((k, steps)),
    )
    for a in range(k):
        for axis in range(2):
            velocity = batch.initial_velocities[row, active[a], axis]
            scaled.initial_velocities[a, axis] = velocity / limits[0]
        for s in range(steps):
            for axis in range(2):
                scaled.centers[a, s, axis] = centers[active[a], s, axis] / limits[0]
            scaled.radii[a, s] = (radii[active[a], s] / limits[0]) ** 2
    return scaled


@kernel
def read(u: FloatArray, active: IntArray, unit: float, y: FloatArray) -> None:
    """Write the trajectories of the active members from u (H, 2n)."""
    k = active.size
    for s in range(u.shape[0]):
        for a in range(k):
            for axis in range(2):
                y[2 * (s * k + a) + axis] = u[s, 2 * active[a] + axis] / unit


@kernel
def write(y: FloatArray, active: IntArray, unit: float, u: FloatArray) -> None:
    """Write the trajectories of the active members to u (H, 2n)."""
    k = active.size
    for s in range(u.shape[0]):
        for a in range(k):
            for axis in range(2):
                u[s, 2 * active[a] + axis] = unit * y[2 * (s * k + a) + axis]


@allocating_kernel
def move_inside(inside: FloatArray, guess: FloatArray, constraints: Constraints) -> None:
    """Move every member's trajectory in `guess` towards `inside` until it has a margin.

    The limits are a product over members: one that can move little does not restrict the others.
    """
    members, steps = constraints.radii.shape
    slack, step = np.empty(3 * guess.size), np.empty(guess.size)
    slacks(inside, constraints, slack)
    for a in range(members):
        clear(step)
        for s in range(steps):
            for axis in range(2):
                c = 2 * (s * members + a) + axis
                step[c] = guess[c] - inside[c]
        length = max_step_length(inside, step, 1.0 - MARGIN, slack, constraints)
        for s in range(steps):
            for axis in range(2):
                c = 2 * (s * members + a) + axis
                guess[c] = inside[c] + length * step[c]


@kernel
def largest_violation(slack: FloatArray, constraints: Constraints) -> float:
    """Largest violation of a constraint as a distance, in units."""
    members, violation = constraints.radii.shape[0], 0.0
    for row in range(slack.size):
        if slack[row] < 0.0:
            bound = 0.0
            if row % ROWS == 4:
                bound = math.sqrt(constraints.acceleration)
            elif row % ROWS == 5:
                bound = math.sqrt(constraints.radii[row // ROWS % members, row // (ROWS * members)])
            out = math.sqrt(bound * bound - slack[row]) - bound if row % ROWS > 3 else -slack[row]
            violation = max(violation, out)
    return violation


@allocating_kernel
def verify(
    z: FloatArray, objective: Objective, constraints: Constraints
) -> tuple[float, float, float]:
    """Objective, violation and residual of the answer `u`, recomputed from the problem alone.

    The violation is a distance, in units; the residual is the larger of stationarity and
    complementarity.
    """
    slack, y, lagrangian = np.empty(z.size), np.empty(z.size // 3), np.empty(z.size // 3)
    read(objective.u, objective.active, objective.scale[0], y)
    value = total(y, objective)
    slacks(y, constraints, slack)
    gather(objective, lagrangian)
    add_jacobian_transpose(y, z, constraints, lagrangian)
    violation, least = largest_violation(slack, constraints), 0.0
    for row in range(z.size):
        least = min(least, z[row])
    stationarity, complementarity = residuals(lagrangian, z, slack, 0.0)
    if not (math.isfinite(value) and math.isfinite(stationarity)) or least < 0.0:
        return value * objective.scale[1], math.inf, math.nan
    return value * objective.scale[1], violation, max(stationarity, complementarity)


@allocating_kernel
def minimise_state(
    starts: FloatArray,
    z: FloatArray,
    objective: Objective,
    constraints: Constraints,
    options: Options,
    counts: IntArray,
) -> int:
    """Solve a state from every start (S, H, 2n), with multipliers z; return the outcome.

    `objective.u` begins strictly inside, and ends as the answer.
    """
    trials, active, unit = starts.shape[0], objective.active, objective.scale[0]
    tolerance, mu_final = options.tolerance, options.mu_final
    inside, y, best = np.empty(z.size // 3), np.empty(z.size // 3), np.empty(z.size // 3)
    slack, best_z = np.empty(z.size), np.zeros(z.size)
    read(objective.u, active, unit, inside)
    copy(inside, best)
    least, outcome = math.inf, NO_INTERIOR
    if not slacks(inside, constraints, slack) > 0.0:
        return outcome
    for t in range(trials + 1 if trials > 1 else 1):
        coarse = t < trials and trials > 1
        if t < trials:
            read(starts[t], active, unit, y)
            move_inside(inside, y, constraints)
            clear(z)
        else:
            copy(best, y)
            copy(best_z, z)
        schedule = Schedule(
            max(MU_INIT if t < trials else COARSE, mu_final),
            max(COARSE, mu_final) if coarse else mu_final,
            max(COARSE, tolerance) if coarse else tolerance,
            options.max_iter,
        )
        value, outcome = minimise(y, z, objective, constraints, schedule, counts)
        if not coarse or (outcome != NOT_FINITE and value < least):
            least = value
            copy(y, best)
            copy(z, best_z)
    copy(best_z, z)
    write(best, active, unit, objective.u)
    return outcome


@allocating_kernel
def minimise_batch(
    rows: tuple[int, int],
    evaluate: Any,
    batch: Batch,
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
        active, u = np.flatnonzero(batch.free[row]), results.x[row]
        objective = Objective(
            evaluate, batch.p[row], batch.constants, batch.scale[row], active, u, gradients, scratch
        )
        constraints = scaled_constraints(batch, row, active)
        z = np.zeros(ROWS * active.size * steps)
        for s in range(steps):
            for c in range(2 * n):
                u[s, c] = batch.inside[row, s, c]
        results.outcome[row] = minimise_state(
            batch.starts[row], z, objective, constraints, options, results.counts[row]
        )
        verified = results.verified[row]
        verified[0], verified[1], verified[2] = verify(z, objective, constraints)
        for s in range(steps):
            for a in range(active.size):
                for c in range(ROWS):
                    multipliers[row, s, active[a], c] = z[ROWS * (s * active.size + a) + c]

"""The objective of a state, and the Newton equations of the interior-point method.

A step's block of the objective's Hessian is taken from differences of gradients: the displacements
of a step enter no other step's objective. See
`casswarm.optimization.solvers.batch.interior_point_kernels` for the method.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...._util.jit import allocating_kernel, kernel
from ....typing import FloatArray, IntArray
from ...feasible_sets.trajectory_kernels import (
    Constraints,
    add_curvature,
    add_jacobian_transpose,
    factor,
    solve,
)

DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
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

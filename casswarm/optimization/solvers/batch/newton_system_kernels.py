"""The problem of a state, and the Newton equations of the interior-point method.

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
from .face_newton_kernels import copy

DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
REGULARISATIONS = 30  # attempts to make the Newton matrix positive definite


class Problem(NamedTuple):
    """A state's problem: the displacements y of its k active members within their limits.

    Fields that are not described are those of the problem in `face_newton_kernels`.

    Parameters
    ----------
    p : (1 or H, np)
        Parameters, for all steps or for each.
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
    factor: FloatArray
    block: FloatArray
    changed: FloatArray


@kernel
def clear(target: FloatArray) -> None:
    """Write zeros."""
    for c in range(target.size):
        target[c] = 0.0


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
    return problem.evaluate(problem.u[s], p, problem.constants, gradient, problem.scratch)  # type: ignore[no-any-return]


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
    )


@kernel
def assemble(y: FloatArray, z: FloatArray, mu: float, problem: Problem, work: Workspace) -> None:
    """Write the condensed Newton equations: the matrix `band` and the right side `residual`."""
    for row in range(z.size):
        work.rows[row] = mu / work.slack[row]
    copy(work.gradient, work.residual)
    add_jacobian_transpose(y, work.rows, problem.constraints, work.residual)
    for r in range(work.band.shape[0]):
        clear(work.band[r])
    add_hessian(problem, work)
    add_curvature(y, z, work.slack, problem.constraints, work.band)

"""Newton steps on the active face of a product of planar sets, state by state.

On the face the Lagrangian is minimised by conjugate gradients, with Hessian products from
differences of gradients; a circle of radius r with multiplier m adds the curvature m / r along it.
In large swarms the Hessian's diagonal blocks precondition them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...._util.jit import kernel
from ....typing import FloatArray, IntArray
from ...feasible_sets.planar_kernels import nearest
from ...objective_kernels import LARGE_SWARM
from .face_kernels import blocking_length, project_on_face, shorten_members, tangent
from .preconditioner_kernels import invert_blocks, precondition, write_identity

DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
FORCING = 1e-3  # residual at which the conjugate gradients stop, relative to the first
MAX_ITERATIONS = 30  # of the conjugate gradients
MAX_STEP = 0.1  # the longest step, or of large swarms that of a member, in units of x
TRIALS = 4  # of a step's length
SUFFICIENT = 1e-4  # sufficient decrease, as a fraction of what the slope predicts

GRADIENT, DIRECTION, TRIAL, TRIAL_GRADIENT, STEP, RESIDUAL, CONJUGATE, PRODUCT = range(8)
"""Rows of `Workspace.vectors`."""


class Problem(NamedTuple):
    """One state's problem: an objective over a product of n planar sets.

    Parameters
    ----------
    evaluate : objective
        See `casswarm._util.jit.objective`.
    p, constants : vectors
        Parameters of the state, and numbers that all states share.
    sets : (n, 10)
        See `casswarm.optimization.feasible_sets.planar_kernels`.
    scale : (2,)
        Units of x and of the objective.
    scratch : vector
        Overwritten by `evaluate`.
    """

    evaluate: Any
    p: FloatArray
    constants: FloatArray
    sets: FloatArray
    scale: FloatArray
    scratch: FloatArray


class Workspace(NamedTuple):
    """Arrays that a solve overwrites.

    Parameters
    ----------
    vectors : (8, 2n)
        Rows `GRADIENT` to `PRODUCT`.
    step_sizes : (n,)
        Spectral step size of every member.
    history : vector
        The last objective values.
    face : (n, 4)
        What `tangent` returns of every member.
    blocks : (5n,)
        A gradient, and the preconditioner's inverse (xx, xy, yy) of every member.
    """

    vectors: FloatArray
    step_sizes: FloatArray
    history: FloatArray
    face: FloatArray
    blocks: FloatArray


@kernel
def evaluate(problem: Problem, x: FloatArray, gradient: FloatArray) -> float:
    """Objective at x; its gradient is written."""
    return problem.evaluate(x, problem.p, problem.constants, gradient, problem.scratch)  # type: ignore[no-any-return]


@kernel
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy without slices, whose error messages take Numba seconds to compile."""
    for c in range(source.size):
        target[c] = source[c]


@kernel
def largest_component(vector: FloatArray) -> float:
    """Largest magnitude of a component."""
    largest = 0.0
    for c in range(vector.size):
        largest = max(largest, abs(vector[c]))
    return largest


@kernel
def longest_displacement(vector: FloatArray) -> float:
    """Largest length of a member's part."""
    longest = 0.0
    for i in range(vector.size // 2):
        longest = max(longest, vector[2 * i] ** 2 + vector[2 * i + 1] ** 2)
    return math.sqrt(longest)


@kernel
def hessian_product(x: FloatArray, problem: Problem, work: Workspace) -> float:
    """Write the reduced Hessian of the Lagrangian times q = `CONJUGATE`; return q'Hq."""
    q, product, gradient = work.vectors[CONJUGATE], work.vectors[PRODUCT], work.vectors[GRADIENT]
    trial, trial_gradient = work.vectors[TRIAL], work.vectors[TRIAL_GRADIENT]
    length = DIFFERENCE * problem.scale[0] / largest_component(q)
    for c in range(x.size):
        trial[c] = x[c] + length * q[c]
    evaluate(problem, trial, trial_gradient)
    for c in range(x.size):
        product[c] = (trial_gradient[c] - gradient[c]) / length
    project_on_face(product, work.face, product)
    total = 0.0
    for c in range(x.size):
        product[c] += work.face[c // 2, 3] * q[c]
        total += q[c] * product[c]
    return total


@kernel
def write_preconditioner(
    x: FloatArray, problem: Problem, work: Workspace, counts: IntArray
) -> None:
    """Write the preconditioner's inverse on the face: of few members, the identity there."""
    inverse = work.blocks[x.size :]
    if work.face.shape[0] < LARGE_SWARM:
        write_identity(work.face, inverse)
        return
    inverse[:] = 0.0  # what an objective without blocks leaves
    evaluate(problem, x, work.blocks)
    counts[1] += 1
    invert_blocks(inverse, work.face)


@kernel
def conjugate_gradients(
    x: FloatArray, problem: Problem, work: Workspace, counts: IntArray
) -> tuple[bool, bool]:
    """Write the Newton step on the face: (whether there is one, without negative curvature)."""
    residual, step = work.vectors[RESIDUAL], work.vectors[STEP]
    q, product = work.vectors[CONJUGATE], work.vectors[PRODUCT]
    project_on_face(work.vectors[GRADIENT], work.face, residual)
    inverse = work.blocks[x.size :]
    write_preconditioner(x, problem, work, counts)
    first = square = precondition(residual, inverse, q)
    if not 0.0 < first < math.inf:
        return False, False
    for c in range(x.size):
        step[c] = 0.0
        residual[c] = -residual[c]
        q[c] = -q[c]
    for _ in range(MAX_ITERATIONS):
        curvature = hessian_product(x, problem, work)
        counts[1] += 1
        if not curvature > 0.0:
            length = MAX_STEP * problem.scale[0] / largest_component(q)
            for c in range(x.size):  # unbounded below along q: the longest step that is allowed
                step[c] += length * q[c]
            return True, False
        length = square / curvature
        for c in range(x.size):
            step[c] += length * q[c]
            residual[c] -= length * product[c]
        next_square = precondition(residual, inverse, product)
        if next_square <= FORCING * FORCING * first:
            break
        for c in range(x.size):
            q[c] = product[c] + next_square / square * q[c]
        square = next_square
    return True, True


@kernel
def newton_step(
    x: FloatArray, f: float, problem: Problem, work: Workspace, counts: IntArray
) -> tuple[float, bool, bool]:
    """Try a Newton step: (f at `trial`, whether it is accepted, without negative curvature).

    Reads the vectors `GRADIENT` and `DIRECTION`; writes `TRIAL` and `TRIAL_GRADIENT`.
    """
    sets, unit, face = problem.sets, problem.scale[0], work.face
    gradient, direction = work.vectors[GRADIENT], work.vectors[DIRECTION]
    step, trial = work.vectors[STEP], work.vectors[TRIAL]
    for i in range(sets.shape[0]):
        face[i, 0], face[i, 1], face[i, 2], face[i, 3] = tangent(
            i, x, gradient, direction, sets, unit
        )
    exists, convex = conjugate_gradients(x, problem, work, counts)
    if not exists:
        return f, False, False
    length = 1.0
    if sets.shape[0] < LARGE_SWARM:
        length = min(1.0, MAX_STEP * unit / largest_component(step))
    else:  # where a member's large step must not shorten those of all
        shorten_members(step, MAX_STEP * unit)
    slope = 0.0
    for c in range(x.size):
        slope += gradient[c] * step[c]
    if not slope < 0.0:
        return f, False, False
    blocked = blocking_length(x, step, sets, unit)
    for attempt in range(TRIALS):
        for i in range(sets.shape[0]):
            px, py = x[2 * i] + length * step[2 * i], x[2 * i + 1] + length * step[2 * i + 1]
            trial[2 * i], trial[2 * i + 1], _exists = nearest(px, py, sets, i)
        trial_f = evaluate(problem, trial, work.vectors[TRIAL_GRADIENT])
        counts[1] += 1
        if trial_f <= f + SUFFICIENT * length * slope + 2.0**-50 * abs(f):
            return trial_f, True, convex
        length = blocked if attempt == 0 and blocked < length else 0.25 * length
    return f, False, False

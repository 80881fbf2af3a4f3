"""Faces of a product of planar sets, and Newton steps on the active one, state by state.

On the face the Lagrangian is minimised by conjugate gradients, with Hessian products from
differences of gradients; a circle of radius r with multiplier m adds the curvature m / r along it.
In large swarms the Hessian's diagonal blocks precondition them.

On a face every member is free (in the plane), on one boundary (free along it), or fixed in a
corner. Sets are rows of `casswarm.motion.planar_kernels`; `unit` is that of x.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..compiled.kernels import kernel
from ..motion.planar_kernels import DISCS, nearest
from ..typing import FloatArray, IntArray
from .spectral_kernels import LARGE_SWARM, SUFFICIENT, invert_blocks, precondition, write_identity

ACTIVE = 1e-10  # a boundary nearer than this is active, in units of x
FIXED = 1e-9  # a member whose projected gradient is shorter is fixed, in units of x


@kernel
def tangent(
    i: int,
    x: FloatArray,
    gradient: FloatArray,
    direction: FloatArray,
    sets: FloatArray,
    unit: float,
) -> tuple[int, float, float, float]:
    """Tangent space of member i's face: (degrees of freedom, tx, ty, curvature).

    Only the active boundaries that the negative gradient presses on count.
    """
    gx, gy = gradient[2 * i], gradient[2 * i + 1]
    px, py = x[2 * i], x[2 * i + 1]
    dx, dy = direction[2 * i], direction[2 * i + 1]
    displacement = math.sqrt(dx * dx + dy * dy)
    pressed, tx, ty, curvature, largest = 0, 0.0, 0.0, 0.0, 0.0
    for side in range(4):  # the box's normals: -x, -y, +x, +y
        if abs((px if side % 2 == 0 else py) - sets[i, side]) <= ACTIVE * unit:
            sign = -1.0 if side < 2 else 1.0
            multiplier = -sign * (gx if side % 2 == 0 else gy)
            if multiplier > 0.0:
                pressed += 1
                if multiplier > largest:
                    largest, curvature = multiplier, 0.0
                    tx, ty = (0.0, 1.0) if side % 2 == 0 else (1.0, 0.0)
    for k in DISCS:
        r = sets[i, k + 2]
        if r < math.inf:
            nx, ny = px - sets[i, k], py - sets[i, k + 1]
            distance = math.sqrt(nx * nx + ny * ny)
            if distance > 0.0 and abs(distance - r) <= ACTIVE * unit:
                nx, ny = nx / distance, ny / distance
                multiplier = -(gx * nx + gy * ny)
                if multiplier > 0.0:
                    pressed += 1
                    if multiplier > largest:
                        largest, curvature = multiplier, multiplier / r
                        tx, ty = -ny, nx
    if pressed == 0:
        return 2, 0.0, 0.0, 0.0
    point = sets[i, 0] == sets[i, 2] and sets[i, 1] == sets[i, 3]
    if point or (pressed > 1 and displacement <= FIXED * unit):
        return 0, 0.0, 0.0, 0.0
    return 1, tx, ty, curvature


@kernel
def project_on_face(vector: FloatArray, face: FloatArray, out: FloatArray) -> float:
    """Write the part of a vector in the face's tangent space; return its squared length."""
    total = 0.0
    for i in range(vector.size // 2):
        vx, vy = vector[2 * i], vector[2 * i + 1]
        if face[i, 0] == 1.0:
            along = vx * face[i, 1] + vy * face[i, 2]
            vx, vy = along * face[i, 1], along * face[i, 2]
        elif face[i, 0] == 0.0:
            vx, vy = 0.0, 0.0
        out[2 * i], out[2 * i + 1] = vx, vy
        total += vx * vx + vy * vy
    return total


@kernel
def blocking_length(x: FloatArray, step: FloatArray, sets: FloatArray, unit: float) -> float:
    """Length of a step at which it meets the first boundary that is not active at x."""
    shortest = math.inf
    for i in range(sets.shape[0]):
        sx, sy = step[2 * i], step[2 * i + 1]
        for side in range(4):
            distance = sets[i, side] - (x[2 * i] if side % 2 == 0 else x[2 * i + 1])
            rate = sx if side % 2 == 0 else sy
            if abs(distance) > ACTIVE * unit and distance * rate > 0.0:
                shortest = min(shortest, distance / rate)
        for k in DISCS:
            wx, wy, r = x[2 * i] - sets[i, k], x[2 * i + 1] - sets[i, k + 1], sets[i, k + 2]
            if r < math.inf and math.sqrt(wx * wx + wy * wy) < r - ACTIVE * unit:
                inside = r * r - wx * wx - wy * wy
                outward, square = wx * sx + wy * sy, sx * sx + sy * sy
                rate = outward + math.sqrt(outward * outward + square * inside)
                if rate > 0.0:
                    shortest = min(shortest, inside / rate)
    return shortest


@kernel
def shorten_members(step: FloatArray, longest: float) -> None:
    """Shorten the parts of members that are longer."""
    for i in range(step.size // 2):
        length = math.sqrt(step[2 * i] ** 2 + step[2 * i + 1] ** 2)
        if length > longest:
            step[2 * i] *= longest / length
            step[2 * i + 1] *= longest / length


DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
FORCING = 1e-3  # residual at which the conjugate gradients stop, relative to the first
MAX_ITERATIONS = 30  # of the conjugate gradients
MAX_STEP = 0.1  # the longest step, or of large swarms that of a member, in units of x
TRIALS = 4  # of a step's length

GRADIENT, DIRECTION, TRIAL, TRIAL_GRADIENT, STEP, RESIDUAL, CONJUGATE, PRODUCT = range(8)
"""Rows of `Workspace.vectors`."""


class Problem(NamedTuple):
    """Formation problem of one state: an objective over a product of n planar sets."""

    evaluate: Any  # see `casswarm.compiled.kernels.objective`
    p: FloatArray  # parameters of the state
    constants: FloatArray  # numbers that all states share
    sets: FloatArray  # (n, 13), see `casswarm.motion.planar_kernels`
    scale: FloatArray  # (2,), units of x and of the objective
    scratch: FloatArray  # overwritten by `evaluate`


class Workspace(NamedTuple):
    """Arrays that a solve overwrites."""

    vectors: FloatArray  # (8, 2n), rows `GRADIENT` to `PRODUCT`
    step_sizes: FloatArray  # (n,), spectral step size of every member
    history: FloatArray  # the last objective values
    face: FloatArray  # (n, 4), what `tangent` returns of every member
    blocks: FloatArray  # (5n,), a gradient, and the preconditioner's inverse (xx, xy, yy) by member


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

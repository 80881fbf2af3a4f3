"""Faces of a product of planar sets: what a member's active boundaries leave it free to do.

On a face every member is free (in the plane), on one boundary (free along it), or fixed in a
corner. Sets are rows of `casswarm.optimization.feasible_sets.planar_kernels`; `unit` is that of x.
"""

from __future__ import annotations

import math

from ...._util.jit import kernel
from ....typing import FloatArray
from ...feasible_sets.planar_kernels import DISCS

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

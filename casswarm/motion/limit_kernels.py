"""Sets of the velocities that limits of motion allow, and derivatives of the projection on them."""

from __future__ import annotations

import math

from ..compiled.kernels import kernel
from ..typing import FloatArray


@kernel
def motion_set(vx: float, vy: float, v_max: float, change: float, sets: FloatArray, i: int) -> None:
    """Write set i of ``planar_kernels``: |v| <= v_max by component, |v - (vx, vy)| <= change."""
    sets[i, 0], sets[i, 1], sets[i, 2], sets[i, 3] = -v_max, -v_max, v_max, v_max
    sets[i, 4], sets[i, 5], sets[i, 6] = vx, vy, change
    sets[i, 7], sets[i, 8], sets[i, 9] = 0.0, 0.0, math.inf


@kernel
def motion_sets(
    previous_velocities: FloatArray, v_max: float, change: float, sets: FloatArray
) -> None:
    """Write the sets (M, 10) of members with previous velocities (M, 2)."""
    for i in range(sets.shape[0]):
        motion_set(previous_velocities[i, 0], previous_velocities[i, 1], v_max, change, sets, i)


@kernel
def project_adjoint(
    commanded: FloatArray,
    previous: FloatArray,
    projected: FloatArray,
    v_max: float,
    seeds: FloatArray,
    to_commanded: FloatArray,
    to_previous: FloatArray,
) -> None:
    """Write the products of seeds with the derivatives of M projections; all arrays are (M, 2).

    The projection q of p on a box and the disc of radius r around c is the clip of p to the box,
    the point c + r (p - c) / |p - c| of the circle, or a crossing of the circle with a line of the
    box, which does not depend on p: see ``feasible_sets.planar``. At ties of these cases, which are
    of measure zero, the derivative is that of one of them.
    """
    for m in range(commanded.shape[0]):
        px, py, cx, cy = commanded[m, 0], commanded[m, 1], previous[m, 0], previous[m, 1]
        qx, qy, sx, sy = projected[m, 0], projected[m, 1], seeds[m, 0], seeds[m, 1]
        to_commanded[m, 0], to_commanded[m, 1] = 0.0, 0.0
        to_previous[m, 0], to_previous[m, 1] = 0.0, 0.0
        inx, iny = min(max(px, -v_max), v_max), min(max(py, -v_max), v_max)
        if qx == inx and qy == iny:
            to_commanded[m, 0] = sx if px == inx else 0.0
            to_commanded[m, 1] = sy if py == iny else 0.0
        elif abs(qx) < v_max and abs(qy) < v_max:
            dx, dy = px - cx, py - cy
            distance = math.sqrt(dx * dx + dy * dy)
            ux, uy = dx / distance, dy / distance
            radius = (qx - cx) * ux + (qy - cy) * uy
            along = sx * ux + sy * uy
            gx, gy = radius / distance * (sx - along * ux), radius / distance * (sy - along * uy)
            to_commanded[m, 0], to_commanded[m, 1] = gx, gy
            to_previous[m, 0], to_previous[m, 1] = sx - gx, sy - gy
        elif abs(qy) < v_max:  # q = (line, c_y +- sqrt(r^2 - (line - c_x)^2))
            to_previous[m, 1] = sy
            if qy != cy:
                to_previous[m, 0] = sy * (qx - cx) / (qy - cy)
        elif abs(qx) < v_max:
            to_previous[m, 0] = sx
            if qx != cx:
                to_previous[m, 1] = sx * (qy - cy) / (qx - cx)

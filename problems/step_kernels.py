"""Sets of the velocities that a member's limits of motion allow, one member at a time."""

from __future__ import annotations

import math

from .._util.jit import kernel
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

"""The member nearest to a point, state by state."""

from __future__ import annotations

import math

from .._util.jit import kernel
from ..typing import BoolArray, FloatArray, IntArray


@kernel
def separation(positions: FloatArray, row: int, i: int, points: FloatArray) -> float:
    """Distance of a member to its state's point."""
    east, north = positions[row, i, 0] - points[row, 0], positions[row, i, 1] - points[row, 1]
    return math.sqrt(east * east + north * north)


@kernel
def nearest_living(
    positions: FloatArray, alive: BoolArray, points: FloatArray, tie: float, members: IntArray
) -> None:
    """Write the first living member that is nearest to the points (B, 2), up to `tie`; 0 if none.

    A distance that is not finite counts as infinite.
    """
    for row in range(positions.shape[0]):
        least = math.inf
        members[row] = 0
        for i in range(positions.shape[1]):
            distance = separation(positions, row, i, points)
            if alive[row, i] and distance < least:
                least = distance
        for i in range(positions.shape[1] - 1, -1, -1):
            distance = separation(positions, row, i, points)
            if alive[row, i] and distance <= least + tie:
                members[row] = i

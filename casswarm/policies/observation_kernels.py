"""Observations of a batch of states, one number after another."""

from __future__ import annotations

from typing import Any, NamedTuple

from .._util.jit import kernel
from ..typing import BoolArray, FloatArray, IntArray


class Frame(NamedTuple):
    """What positions, velocities and steps are measured in.

    Parameters
    ----------
    east, north : float
        Centre of the target.
    length, speed : float
        Units of positions and velocities.
    n_steps : int
    """

    east: float
    north: float
    length: float
    speed: float
    n_steps: int


@kernel
def write_observations(
    frame: Frame,
    steps: IntArray,
    positions: FloatArray,
    velocities: FloatArray,
    alive: BoolArray,
    radars: FloatArray,
    members: FloatArray,
    observations: Any,
) -> None:
    """Write the observations (B, n, d) of B states, see `casswarm.policies.observation`.

    `radars` (k, 2) are relative to the target, in lengths; `members` (n, 4) is overwritten.
    """
    batch, n = alive.shape
    of_length, of_speed = 1.0 / frame.length, 1.0 / frame.speed
    for b in range(batch):
        left = (frame.n_steps - steps[b]) / frame.n_steps
        for i in range(n):
            members[i, 0] = (positions[b, i, 0] - frame.east) * of_length
            members[i, 1] = (positions[b, i, 1] - frame.north) * of_length
            members[i, 2] = velocities[b, i, 0] * of_speed
            members[i, 3] = velocities[b, i, 1] * of_speed
        for i in range(n):
            row = observations[b, i]
            if not alive[b, i]:
                row[:] = 0.0
                continue
            east, north = members[i, 0], members[i, 1]
            row[0], row[1], row[2], row[3] = 1.0, left, east, north
            row[4], row[5] = members[i, 2], members[i, 3]
            at = 6
            for r in range(radars.shape[0]):
                row[at], row[at + 1] = radars[r, 0] - east, radars[r, 1] - north
                at += 2
            for j in range(n):
                if j == i:
                    continue
                other = row[at : at + 5]
                if alive[b, j]:
                    other[0] = 1.0
                    other[1], other[2] = members[j, 0] - east, members[j, 1] - north
                    other[3], other[4] = members[j, 2], members[j, 3]
                else:
                    other[:] = 0.0
                at += 5

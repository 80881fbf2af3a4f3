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
    radars : (k, 2)
    """

    east: float
    north: float
    length: float
    speed: float
    n_steps: int
    radars: FloatArray


@kernel
def write_observations(
    frame: Frame,
    steps: IntArray,
    positions: FloatArray,
    velocities: FloatArray,
    alive: BoolArray,
    observations: Any,
) -> None:
    """Write the observations (B, n, d) of B states, see `casswarm.policies.observation`."""
    batch, n = alive.shape
    for b in range(batch):
        left = (frame.n_steps - steps[b]) / frame.n_steps
        for i in range(n):
            row = observations[b, i]
            if not alive[b, i]:
                row[:] = 0.0
                continue
            east, north = positions[b, i, 0], positions[b, i, 1]
            row[0], row[1] = 1.0, left
            row[2] = (east - frame.east) / frame.length
            row[3] = (north - frame.north) / frame.length
            row[4] = velocities[b, i, 0] / frame.speed
            row[5] = velocities[b, i, 1] / frame.speed
            at = 6
            for r in range(frame.radars.shape[0]):
                row[at] = (frame.radars[r, 0] - east) / frame.length
                row[at + 1] = (frame.radars[r, 1] - north) / frame.length
                at += 2
            for j in range(n):
                if j == i:
                    continue
                if alive[b, j]:
                    row[at] = 1.0
                    row[at + 1] = (positions[b, j, 0] - east) / frame.length
                    row[at + 2] = (positions[b, j, 1] - north) / frame.length
                    row[at + 3] = velocities[b, j, 0] / frame.speed
                    row[at + 4] = velocities[b, j, 1] / frame.speed
                else:
                    row[at : at + 5] = 0.0
                at += 5

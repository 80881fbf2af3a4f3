"""Observations of a batch of states, one number after another."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import kernel
from ..typing import BoolArray, FloatArray, IntArray

_ZERO, _ONE = np.uint64(0), np.uint64(1)


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
        Relative to the target, in lengths.
    """

    east: float
    north: float
    length: float
    speed: float
    n_steps: int
    radars: FloatArray


@kernel
def append(numbers: Any, at: Any, first: float, second: float) -> Any:
    """Write two numbers from an index on; return the index after them.

    The index is unsigned: Numba examines others for negative values, which takes a third of the
    time.
    """
    numbers[at] = first
    numbers[at + _ONE] = second
    return at + _ONE + _ONE


@kernel
def append_zeros(numbers: Any, at: Any, count: int) -> Any:
    """Write zeros from an unsigned index on; return the index after them."""
    for _ in range(count):
        numbers[at] = 0.0
        at += _ONE
    return at


@kernel
def write_observations(
    frame: Frame,
    steps: IntArray,
    positions: FloatArray,
    velocities: FloatArray,
    alive: BoolArray,
    members: FloatArray,
    observations: Any,
) -> None:
    """Write the observations of B states, see `casswarm.policies.observation`.

    `members` (n, 4) is overwritten; `observations` (B n d,) are flat.
    """
    batch, n = alive.shape
    radars = frame.radars
    size = 6 + 2 * radars.shape[0] + 5 * (n - 1)
    of_length, of_speed = 1.0 / frame.length, 1.0 / frame.speed
    at = _ZERO
    for b in range(batch):
        left = (frame.n_steps - steps[b]) / frame.n_steps
        for i in range(n):
            members[i, 0] = (positions[b, i, 0] - frame.east) * of_length
            members[i, 1] = (positions[b, i, 1] - frame.north) * of_length
            members[i, 2] = velocities[b, i, 0] * of_speed
            members[i, 3] = velocities[b, i, 1] * of_speed
        for i in range(n):
            if not alive[b, i]:
                at = append_zeros(observations, at, size)
                continue
            east, north = members[i, 0], members[i, 1]
            at = append(observations, at, 1.0, left)
            at = append(observations, at, east, north)
            at = append(observations, at, members[i, 2], members[i, 3])
            for r in range(radars.shape[0]):
                at = append(observations, at, radars[r, 0] - east, radars[r, 1] - north)
            for j in range(n):
                if j == i:
                    continue
                if alive[b, j]:
                    observations[at] = 1.0
                    at += _ONE
                    at = append(observations, at, members[j, 0] - east, members[j, 1] - north)
                    at = append(observations, at, members[j, 2], members[j, 3])
                else:
                    at = append_zeros(observations, at, 5)

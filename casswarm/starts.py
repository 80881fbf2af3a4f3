"""Initial paths for the guide problem: the straight line, and ways around the radars."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from .arrays import Floats

ALL_SIDES = 4  # radars up to which every combination of sides is tried
CLEARANCE = 0.15  # how far beside a radar a way leads, in distances from start to target


def straight(start: Floats, goal: Floats) -> Floats:
    """The straight line, as a polyline (2, 2)."""
    return np.stack([start, goal])


def around(start: Floats, goal: Floats, radars: Floats) -> Iterator[tuple[str, Floats]]:
    """Polylines that pass the radars on chosen sides, each with its name.

    Up to `ALL_SIDES` radars: every combination of left and right. Beyond, the combinations that
    differ from the straight line's own in one radar, and the two that pass all on one side.

    Parameters
    ----------
    start, goal : (2,)
    radars : (k, 2)

    Yields
    ------
    name : str
        A letter a radar: the side of the path on which it lies, as in `sides_of`.
    polyline : (m, 2)
    """
    way = goal - start
    length = float(np.hypot(*way))
    if not len(radars) or length == 0.0:
        return
    along = way / length
    left = np.array([-along[1], along[0]])
    progress, offset = (radars - start) @ along, (radars - start) @ left
    order = np.argsort(progress)
    clearance = CLEARANCE * length
    for sides in _combinations(offset > 0):
        # beside a radar that is to lie on the left, the path keeps to the right of it
        beside = np.where(
            sides, np.minimum(0.0, offset - clearance), np.maximum(0.0, offset + clearance)
        )
        at = np.clip(progress, 0.05 * length, 0.95 * length)
        corners = start + at[:, None] * along + beside[:, None] * left
        name = "".join("L" if side else "R" for side in sides)
        yield name, np.vstack([start, corners[order], goal])


def _combinations(natural: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    k = len(natural)
    if k <= ALL_SIDES:
        return [np.array(sides) for sides in product((True, False), repeat=k)]
    flips = [natural ^ (np.arange(k) == radar) for radar in range(k)]
    return [natural, np.ones(k, bool), np.zeros(k, bool), *flips]


def resampled(polyline: Floats, steps: int, dt: float) -> Floats:
    """Velocities (steps, 2) that follow a polyline (m, 2) at constant speed."""
    lengths = np.hypot(*np.diff(polyline, axis=0).T)
    distance = np.concatenate([[0.0], np.cumsum(lengths)])
    wanted = np.linspace(0.0, distance[-1], steps + 1)
    path = np.stack([np.interp(wanted, distance, polyline[:, axis]) for axis in (0, 1)], axis=1)
    return np.diff(path, axis=0) / dt

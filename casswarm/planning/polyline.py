"""Initial paths for the guide problem along polylines."""

from __future__ import annotations

import numpy as np

from ..typing import FloatArray


def straight(start: FloatArray, goal: FloatArray) -> FloatArray:
    """The straight line, as a polyline (2, 2)."""
    return np.stack([start, goal])


def resampled(polyline: FloatArray, steps: int, dt: float) -> FloatArray:
    """Velocities (steps, 2) that follow a polyline (m, 2) at constant speed."""
    lengths = np.hypot(*np.diff(polyline, axis=0).T)
    distance = np.concatenate([[0.0], np.cumsum(lengths)])
    wanted = np.linspace(0.0, distance[-1], steps + 1)
    path = np.stack([np.interp(wanted, distance, polyline[:, axis]) for axis in (0, 1)], axis=1)
    return np.diff(path, axis=0) / dt

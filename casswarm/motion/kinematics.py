"""Kinematics of agents: integrated velocities, reachability, and velocities along polylines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..typing import FloatArray


def integrate(start: FloatArray, velocities: FloatArray, dt: float) -> FloatArray:
    """Positions X(0..T) of the dynamics X(t+1) = X(t) + dt V(t).

    Parameters
    ----------
    start : (..., 2)
        X(0), of one agent or of several.
    velocities : (T, ..., 2)
        V(0..T-1).
    dt : float
        Length of a time step.

    Returns
    -------
    (T+1, ..., 2)
        X(0..T), rounded as in the chain.
    """
    positions = np.empty((len(velocities) + 1, *np.shape(start)))
    positions[0] = start
    for step, velocity in enumerate(velocities):  # rounds as the chain does
        positions[step + 1] = positions[step] + dt * velocity
    return positions


def interpolated(path: FloatArray, times: FloatArray) -> FloatArray:
    """Points (m, ...) of a path (T+1, ...) at `times` (m,) from 0 to T, in steps."""
    before = np.minimum(times.astype(int), len(path) - 2)
    share = (times - before).reshape(-1, *[1] * (path.ndim - 1))
    return np.asarray((1.0 - share) * path[before] + share * path[before + 1])


def remaining_distance(
    positions: FloatArray, goal: FloatArray, reach: float | NDArray[np.floating[Any]]
) -> FloatArray:
    """Distance (...) to `goal` after the best move of at most `reach` along each axis.

    Velocities are bounded by component, so the reachable set of positions (..., 2) is a square.
    """
    missing = np.maximum(np.abs(goal - positions) - reach, 0.0)
    return np.asarray(np.hypot(missing[..., 0], missing[..., 1]))


def resample(
    polyline: FloatArray, steps: int, dt: float, times: FloatArray | None = None
) -> FloatArray:
    """Velocities (steps, 2) along a polyline (m, 2) whose points are passed at `times` (m,) from 0.

    The times are stretched to the steps; by default the speed is constant.
    """
    if times is None:
        lengths = np.hypot(*np.diff(polyline, axis=0).T)
        times = np.concatenate([[0.0], np.cumsum(lengths)])
    targets = np.linspace(0.0, times[-1], steps + 1)
    path = np.stack([np.interp(targets, times, polyline[:, axis]) for axis in (0, 1)], axis=1)
    return np.diff(path, axis=0) / dt

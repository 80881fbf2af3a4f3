"""Trajectories within limits that follow moving discs as closely as possible."""

from __future__ import annotations

import numpy as np

from ..compiled.kernels import contiguous
from ..typing import BoolArray, FloatArray
from .spectral_kernels import Results
from .trajectory import Limits, distances

_POINTS, _DISCS = ((1e-13, 1e-9),), ((1e-10, 1e-8), (1e-7, 1e-6))
"""Final barrier parameters and residuals, the next where the first is not reached, in units of the
squared speed: for points the answer is unique and smooth, for discs it is neither, and used with a
margin."""

_ACCEPTABLE = 100.0  # times the residual is still accepted
_MAX_ITER = 300
_ROUNDING = 1e-9  # violation of a limit, in its unit, that counts as rounding


def nearest_trajectories(
    limits: Limits, initial_velocities: FloatArray, goals: FloatArray, radii: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Trajectories with the least sum of squared distances to moving discs.

    They minimise sum over s of max(0, |u_s - goal_s| - radius_s)^2, which is convex. Where the
    greedy trajectory touches every disc, or there is only one step, it is the answer; the others
    are found by the interior-point method.

    Parameters
    ----------
    limits : Limits
    initial_velocities : (M, 2)
    goals : (M, H, 2)
        Centres of the discs, as displacements.
    radii : (H,)

    Returns
    -------
    trajectories : (M, H, 2)
        Displacements, within the limits up to rounding.
    failed : (M,) bool
        Where the method did not converge; the greedy trajectory is returned.
    """
    trajectories = limits.greedy(initial_velocities, goals)
    outside = distances(trajectories, goals) > radii + 1e-12 * limits.speed
    failed: BoolArray = np.asarray(outside.any(axis=1) & (goals.shape[1] > 1))
    discs = np.dstack([goals, np.broadcast_to(radii, goals.shape[:2])])
    for tolerances in _DISCS if radii.any() else _POINTS:
        rows = np.flatnonzero(failed)
        if rows.size:
            x, good = _solve(limits, initial_velocities[rows], discs[rows], tolerances)
            trajectories[rows] = np.where(good[:, None, None], x, trajectories[rows])
            failed[rows] = ~good
    return trajectories, failed


def _solve(
    limits: Limits,
    initial_velocities: FloatArray,
    discs: FloatArray,
    tolerances: tuple[float, float],
) -> tuple[FloatArray, BoolArray]:
    """Answers (M, H, 2) for discs (M, H, 3), and whether they are good (M,)."""
    from .horizon_kernels import Batch, Options, minimise_batch
    from .spectral_kernels import Starts
    from .trajectory_kernels import disc_distance  # Numba takes a second to import

    size, steps, _ = discs.shape
    inside = limits.slowing(initial_velocities, steps)
    batch = Batch(
        x0=inside,
        inside=inside,
        free=np.ones((size, 1), bool),
        initial_velocities=contiguous(initial_velocities)[:, None],
        change=limits.change,
        centers=np.zeros((size, steps, 2)),
        radii=np.full((size, steps, 1), np.inf),
        p=discs,
        constants=np.zeros(1),
        scale=np.tile([limits.speed, limits.speed**2], (size, 1)),
    )
    results, multipliers = Results.empty((size, steps, 2)), np.empty((size, steps, 1, 6))
    options = Options(*tolerances, _MAX_ITER)
    minimise_batch((0, size), disc_distance, batch, Starts.single(), options, multipliers, results)
    _, violation, residual = results.verified.T
    return results.x, (violation <= _ROUNDING) & (residual <= _ACCEPTABLE * tolerances[1])

"""A guide that waits for a member that has fallen behind, without memory."""

from __future__ import annotations

import math

import numpy as np

from ..guide.guide import Guide
from ..motion.step import POSITION_TOL
from ..typing import FloatArray


def waiting_goals(
    guide: Guide, speeds: FloatArray, step: int, positions: FloatArray, most: int, horizon: int
) -> FloatArray:
    """The guide's next points (H, B, 2) for members at `positions` (B, 2), of v_max `speeds` (B,).

    With p(s) the guide's path through X*(0), X*(1), ..., linear between these, and L the longest
    way of a member in a step, the first goal is p(sigma) with the largest sigma from
    t + 1 - `most` to t + 1 such that p(sigma) is within L of the member, or, if there is none, the
    one nearest to it. The later goals are p(sigma + 1), p(sigma + 2), ... See "A guide that waits"
    in ``docs/model.md``.
    """
    first = max(0, step + 1 - most)
    path = np.stack([guide.reference(s) for s in range(first, step + horizon + 1)])
    sigma = _farthest_within(path[: step + 2 - first], positions, _reach(speeds, guide.dt))
    later = sigma[None] + np.arange(horizon)[:, None]
    return _along(path, later)


def _reach(speeds: FloatArray, dt: float) -> FloatArray:
    """L = sqrt(2) v_max dt (B,), up to the accuracy of positions."""
    return math.sqrt(2) * speeds * dt * (1 + POSITION_TOL)


def _farthest_within(path: FloatArray, positions: FloatArray, reach: FloatArray) -> FloatArray:
    """Parameters (B,) of the last points of a path (K+1, 2) within reach (B,) of positions.

    Those of the nearest points where no point is within reach.
    """
    ways = np.diff(path, axis=0)
    offsets = positions[:, None] - path[:-1]  # (B, K, 2)
    squared = (ways * ways).sum(axis=-1)
    inner = (offsets * ways).sum(axis=-1)
    moving = np.where(squared > 0, squared, 1.0)
    beyond = (offsets * offsets).sum(axis=-1) - reach[:, None] ** 2
    # on p(k + u), |offset - u way|^2 <= reach^2 between the roots of a quadratic polynomial
    discriminant = inner * inner - squared * beyond
    root = np.sqrt(np.maximum(discriminant, 0.0))
    before, after = (inner - root) / moving, (inner + root) / moving
    within = np.where(squared > 0, (discriminant >= 0) & (before <= 1) & (after >= 0), beyond <= 0)
    last = np.where(squared > 0, np.minimum(after, 1.0), 1.0)
    nearest = np.where(squared > 0, np.clip(inner / moving, 0.0, 1.0), 1.0)
    left = offsets - nearest[..., None] * ways
    distances = np.where(within, -1.0, (left * left).sum(axis=-1))
    segments = len(ways) - 1 - np.argmin(distances[:, ::-1], axis=1)  # the last one among equals
    rows = np.arange(len(positions))
    found = within[rows, segments]
    return np.asarray(segments + np.where(found, last[rows, segments], nearest[rows, segments]))


def _along(path: FloatArray, parameters: FloatArray) -> FloatArray:
    """Points (..., 2) of a path (K+1, 2) at parameters from 0 to K."""
    below = np.minimum(parameters.astype(int), len(path) - 2)
    part = (parameters - below)[..., None]
    points = path[below] + part * (path[below + 1] - path[below])
    return np.asarray(np.where(part < 1, points, path[below + 1]))

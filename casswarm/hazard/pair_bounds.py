"""Lower bounds of the rates of two members, on grids of the difference of their positions.

A member's rate is b share(r) + collision(r), with the single-agent rate b and the distance r. The
values at nodes are such that their bilinear interpolation is nowhere above these functions: they
are the functions less h^2 / 8 times the largest second derivatives in the cells around, where these
are positive. ``docs/two-members.md`` derives them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..typing import FloatArray
from .lower_bounds import largest_around

_ROUNDED = 1e-13  # by more than the rounding of a node's value


@dataclass(frozen=True, eq=False)
class PairBounds:
    """Lower bounds at the nodes h (i, j) of differences, from (1 - n, 1 - m) to (n - 1, m - 1).

    Parameters
    ----------
    share : (2 n - 1, 2 m - 1)
        Of the ratio of a member's rate without collisions and its single-agent rate; above zero.
    collision : (2 n - 1, 2 m - 1)
        Of the rate of collisions; not negative.
    """

    share: FloatArray
    collision: FloatArray


def pair_bounds(
    shape: tuple[int, int],
    spacing: float,
    alpha: tuple[float, float],
    beta: tuple[float, float] | None,
    core_radius: float,
    certified: bool = True,
) -> PairBounds:
    """Lower bounds for the paper's rates, or the rates themselves at the nodes.

    Parameters
    ----------
    shape : pair of int
        n and m.
    spacing : float
        h.
    alpha : pair of float
        alpha_2 and alpha_3.
    beta : pair of float, optional
        beta_1 and beta_2, if members collide.
    core_radius : float
    certified : bool
    """
    x, y = (np.asarray(spacing * np.arange(1 - count, count), float) for count in shape)
    share = 1.0 - _share_deficit(x[:, None] ** 2 + y**2, *alpha)
    if not certified:
        squared = np.maximum(x[:, None] ** 2 + y**2, core_radius**2)
        scales = beta or (0.0, 1.0)
        return PairBounds(share, (scales[0] ** 2 / squared) ** (scales[1] / 2))
    error = _over_cells(x, y, lambda near, far: _share_curvature(near, far, *alpha))
    share -= largest_around(np.pad(error, 1)) * spacing**2 / 8 + _ROUNDED
    if share.min() <= 0:  # on coarse grids: the least value in the cells around
        nearest = [np.maximum(np.abs(axis) - spacing, 0.0) ** 2 for axis in (x, y)]
        share = 1.0 - _share_deficit(nearest[0][:, None] + nearest[1], *alpha) - _ROUNDED
    collision = np.zeros_like(share)
    if beta is not None:
        collision = _collisions_below(x, y, beta, core_radius)
    return PairBounds(share, collision)


def _collisions_below(
    x: FloatArray, y: FloatArray, beta: tuple[float, float], core_radius: float
) -> FloatArray:
    """With the smallest cap, in whole spacings, that leaves no node value below zero."""
    spacing = abs(x[1] - x[0]) if len(x) > 1 else abs(y[1] - y[0]) if len(y) > 1 else 0.0
    squared = x[:, None] ** 2 + y**2
    for spacings in range(2, 100):
        cap = max(spacings * spacing, 2 * core_radius)
        rates = (beta[0] ** 2 / np.maximum(squared, cap**2)) ** (beta[1] / 2)
        rates *= 1 + beta[1] / 2 * np.maximum(1 - squared / cap**2, 0.0)
        error = _over_cells(x, y, partial(_collision_curvature, beta=beta, cap=cap))
        below = rates * (1 - _ROUNDED) - largest_around(np.pad(error, 1)) * spacing**2 / 8
        if (below >= (1 - min(0.3, 1.2 * spacing / beta[0])) * rates).all():
            return np.asarray(below)
    return np.zeros_like(squared)


def _share_deficit(squared: FloatArray, alpha_2: float, alpha_3: float) -> FloatArray:
    """1 - share = g / (r^2 + q^2)."""
    scale = (1.0 + alpha_2) * alpha_3
    return np.asarray(alpha_2 / (scale * squared + 1.0 + 2.0 * alpha_2))


def _share_curvature(
    near: tuple[FloatArray, FloatArray],
    far: tuple[FloatArray, FloatArray],
    alpha_2: float,
    alpha_3: float,
) -> FloatArray:
    """Bound on the sum of the positive parts of the second derivatives of the share in a cell."""
    scale = (1.0 + alpha_2) * alpha_3
    core = (1.0 + 2.0 * alpha_2) / scale  # q^2
    east = np.maximum(core + far[1] - 3 * near[0], 0.0)
    north = np.maximum(core + far[0] - 3 * near[1], 0.0)
    return np.asarray(2 * alpha_2 / scale * (east + north) / (near[0] + near[1] + core) ** 3)


def _collision_curvature(
    near: tuple[FloatArray, FloatArray],
    far: tuple[FloatArray, FloatArray],
    beta: tuple[float, float],
    cap: float,
) -> FloatArray:
    """The same of the collision rate (beta_1 / r)^beta_2, at distances of at least `cap`."""
    beta_1, beta_2 = beta
    nearest = np.maximum(near[0] + near[1], cap**2)
    east = np.maximum((beta_2 + 1) * far[0] - near[1], 0.0)
    north = np.maximum((beta_2 + 1) * far[1] - near[0], 0.0)
    rate = (beta_1**2 / nearest) ** (beta_2 / 2)
    curvature = beta_2 * (east + north) * rate / nearest**2
    return np.where(far[0] + far[1] <= cap**2, 0.0, curvature)


def _over_cells(x: FloatArray, y: FloatArray, function: Callable[..., FloatArray]) -> FloatArray:
    """A function of the least and the largest squared coordinates, for every cell."""
    low, high = [], []
    for axis in (x, y):
        ends = np.sort(np.stack([axis[:-1] ** 2, axis[1:] ** 2]), axis=0)
        low.append(ends[0])
        high.append(ends[1])
    shape = (len(x) - 1, len(y) - 1)
    near = np.broadcast_to(low[0][:, None], shape), np.broadcast_to(low[1], shape)
    far = np.broadcast_to(high[0][:, None], shape), np.broadcast_to(high[1], shape)
    return np.asarray(function(near, far))

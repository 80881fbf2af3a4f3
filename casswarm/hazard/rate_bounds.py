"""Lower bounds of rates, of single agents and of two members, for certificates.

**Of single-agent rates**, ``docs/global-guide.md``, Node rates: with the regularisation of
`casswarm.hazard.kernel_hazard.regular` below the core radius e, and with R = max(3 h, e) on a grid
of spacing h, the values

    min(1 / r^2, 1 / R^2) - d

at nodes, where d bounds the error of bilinear interpolation in the four cells around the node, are
nowhere above 1 / r^2 when they are interpolated.

**Of a member of a swarm**, ``docs/joint.md``: in every configuration of n members, a member whose
single-agent rate is b has a rate of at least phi(b), where phi is the minimum of nondecreasing
affine functions. Where the densities of its neighbours are known to add up to at most S, fewer of
them count.

**Of two members**, ``docs/two-members.md``: a member's rate is b share(r) + collision(r), with the
single-agent rate b and the distance r. The values at nodes are such that their bilinear
interpolation is nowhere above these functions: they are the functions less h^2 / 8 times the
largest second derivatives in the cells around, where these are positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..typing import FloatArray

_INTERVALS = 4096
_PARTS = 4  # of the side of a cell
_ROUNDED = 1 - 1e-12
"""Downward by more than all rounding here."""


def cap_radius(spacing: float, core_radius: float) -> float:
    """R, the distance to a radar below which the rate counts as if at R."""
    return max(3.0 * spacing, core_radius)


def inverse_squares_below(
    east: FloatArray,
    north: FloatArray,
    spacing: float,
    radars: FloatArray,
    strengths: FloatArray,
    core_radius: float,
) -> FloatArray:
    """Sum over radars of strength times the node values above, shape (n, m).

    The nodes are at `east` (n,) and `north` (m,), h = `spacing` apart.
    """
    squared_cap = cap_radius(spacing, core_radius) ** 2
    total = np.zeros((len(east), len(north)))
    for (x_radar, y_radar), strength in zip(radars, strengths, strict=True):
        x, y = east - x_radar, north - y_radar
        value = np.maximum((x**2)[:, None] + y**2, squared_cap)
        total += np.divide(strength, value, out=value)
        (x_near, x_far), (y_near, y_far) = (_squares_over_cells(axis, spacing) for axis in (x, y))
        curved = np.maximum(6 * x_far[:, None] - 2 * y_near, 0.0)
        curved += np.maximum(6 * y_far - 2 * x_near[:, None], 0.0)
        nearest = np.maximum(x_near[:, None] + y_near, squared_cap)
        nearest[x_far[:, None] + y_far <= squared_cap] = np.inf
        curved *= strength * spacing**2 / 8
        total -= largest_around(np.divide(curved, nearest**3, out=curved))
    return total


def _squares_over_cells(nodes: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Least and largest square in the n + 1 intervals before, between and after n nodes."""
    low = np.append(nodes - spacing, nodes[-1])
    high = low + spacing
    crosses = (low <= 0) & (high >= 0)
    low, high = low**2, high**2
    return np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high)


def largest_around(cells: FloatArray) -> FloatArray:
    """Largest value (n, m) of the cells (n+1, m+1) around every node."""
    rows = np.maximum(cells[:-1], cells[1:])
    return np.asarray(np.maximum(rows[:, :-1], rows[:, 1:]))


def nodes_below(
    rates: FloatArray, nodes: FloatArray, bound: Callable[[FloatArray, FloatArray], FloatArray]
) -> FloatArray:
    """Node values below rates (n, m) at nodes (n, m, 2), from lower bounds over boxes.

    In every cell, interpolated rates exceed `bound`, a function of corners (..., 2) of boxes, by at
    most as much as they do in one of its parts; the nodes around are lowered by that. The error is
    of the order of the parts' size.
    """
    low, sides = nodes[:-1, :-1], nodes[1:, 1:] - nodes[:-1, :-1]
    places = np.arange(_PARTS + 1) / _PARTS
    along = [(1 - s) * rates[:-1] + s * rates[1:] for s in places]
    at = [[(1 - s) * line[:, :-1] + s * line[:, 1:] for s in places] for line in along]
    excess = np.zeros(low.shape[:-1])
    for i, j in np.ndindex(_PARTS, _PARTS):
        least = bound(low + places[[i, j]] * sides, low + places[[i + 1, j + 1]] * sides)
        most = np.maximum(
            np.maximum(at[i][j], at[i][j + 1]), np.maximum(at[i + 1][j], at[i + 1][j + 1])
        )
        np.maximum(excess, most - least, out=excess)
    return rates - largest_around(np.pad(excess, 1)) - (1 - _ROUNDED) * np.abs(rates)


def least_inverse_squares(
    lower: FloatArray,
    upper: FloatArray,
    radars: FloatArray,
    strengths: FloatArray,
    core_radius: float,
) -> FloatArray:
    """Sum over radars of strength times the least 1 / r^2 in a box, (..., 2), (..., 2) to (...)."""
    total = np.zeros(np.broadcast_shapes(lower.shape, upper.shape)[:-1])
    for radar, strength in zip(radars, strengths, strict=True):
        farthest = np.maximum(np.abs(lower - radar), np.abs(upper - radar))
        squared = (farthest**2).sum(axis=-1)
        total += strength / np.maximum(squared, core_radius**2)
    return total


@dataclass(frozen=True, eq=False)
class LeastRate:
    """phi(b) = min over k of intercepts_k + slopes_k b, concave and nondecreasing, for b >= 0.

    Parameters
    ----------
    intercepts, slopes : (k,)
        Not negative.
    """

    intercepts: FloatArray
    slopes: FloatArray

    def __post_init__(self) -> None:
        intercepts, slopes = np.asarray(self.intercepts), np.asarray(self.slopes)
        # the lines that are lowest for some b >= 0 are the lower left hull of (intercept, slope)
        order = np.lexsort((slopes, intercepts))
        lines = order[_lower_hull(intercepts[order], slopes[order])]
        lines = lines[: slopes[lines].argmin() + 1]
        object.__setattr__(self, "intercepts", intercepts[lines])
        object.__setattr__(self, "slopes", slopes[lines])

    def __call__(self, rates: FloatArray) -> FloatArray:
        """phi at single-agent rates (...), which are not negative."""
        ends = np.diff(self.intercepts) / -np.diff(self.slopes)  # where the next line is the lowest
        line = np.searchsorted(ends, rates)
        return np.asarray(self.intercepts[line] + self.slopes[line] * rates)


def _lower_hull(x: FloatArray, y: FloatArray) -> list[int]:
    """Indices of the points, of ascending x, on the lower side of their convex hull."""
    hull: list[int] = []
    for point in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            turn = (x[b] - x[a]) * (y[point] - y[a]) - (y[b] - y[a]) * (x[point] - x[a])
            if turn > 0:
                break
            hull.pop()
        hull.append(point)
    return hull


@dataclass(frozen=True, eq=False)
class LeastRateLines:
    """Lower bounds of a member's rate by the total density S of its neighbours.

    For single-agent rates b, the rate is at least intercepts_k + slopes_k b while S is between
    densities_k and densities_(k+1), or between the last of these and the number of neighbours.
    """

    densities: FloatArray  # (k,), increasing from 0
    intercepts: FloatArray  # (k,), not decreasing
    slopes: FloatArray  # (k,), not increasing

    def least_rate(self) -> LeastRate:
        """phi, the least rate at any density."""
        return LeastRate(self.intercepts, self.slopes)

    def at_most(self, largest: FloatArray, rates: FloatArray) -> FloatArray:
        """Least rates (q, d) at densities up to `largest` (q,), for single-agent rates (d,)."""
        last = np.searchsorted(self.densities, largest, "right") - 1
        lines = self.intercepts[:, None] + self.slopes[:, None] * rates
        return np.asarray(np.minimum.accumulate(lines)[last])


def saturation_least_rates(
    n: int, alpha_2: float, collision: Callable[[FloatArray], FloatArray]
) -> LeastRateLines:
    """Lower bounds of the paper's rates; `collision` is g, the collision rate at h in (0, 1]."""
    neighbours = n - 1
    h = np.linspace(0.0, 1.0, _INTERVALS + 1)
    g = np.zeros_like(h)
    with np.errstate(all="ignore"):
        g[1:] = np.nan_to_num(collision(h[1:]), nan=0.0, posinf=1e300)
    # on [h_k, h_(k+1)) g is at least g(h_k): the convex hull of the steps' lower right corners
    corners = np.append(0.0, g[:-1])
    psi = np.zeros_like(h)
    if corners.any():
        hull = _lower_hull(h, corners)
        psi = np.interp(h, h[hull], corners[hull])
    density = 1.0 + neighbours * h[1:]
    return LeastRateLines(
        neighbours * h[:-1],
        neighbours * psi[:-1] * _ROUNDED,
        (1 + alpha_2) / (1 + alpha_2 * density) * _ROUNDED,
    )


_NODE_ROUNDING = 1e-13  # by more than the rounding of a node's value


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

    `shape` is n and m, the spacing h, `alpha` alpha_2 and alpha_3, and `beta` beta_1 and beta_2 if
    members collide.
    """
    x, y = (np.asarray(spacing * np.arange(1 - count, count), float) for count in shape)
    share = 1.0 - _share_deficit(x[:, None] ** 2 + y**2, *alpha)
    if not certified:
        squared = np.maximum(x[:, None] ** 2 + y**2, core_radius**2)
        scales = beta or (0.0, 1.0)
        return PairBounds(share, (scales[0] ** 2 / squared) ** (scales[1] / 2))
    error = _over_cells(x, y, lambda near, far: _share_curvature(near, far, *alpha))
    share -= largest_around(np.pad(error, 1)) * spacing**2 / 8 + _NODE_ROUNDING
    if share.min() <= 0:  # on coarse grids: the least value in the cells around
        nearest = [np.maximum(np.abs(axis) - spacing, 0.0) ** 2 for axis in (x, y)]
        share = 1.0 - _share_deficit(nearest[0][:, None] + nearest[1], *alpha) - _NODE_ROUNDING
    collision = np.zeros_like(share)
    if beta is not None:
        collision = _collisions_below(x, y, beta, core_radius)
    return PairBounds(share, collision)


def _collisions_below(
    x: FloatArray, y: FloatArray, beta: tuple[float, float], core_radius: float
) -> FloatArray:
    """Lower bounds of collision rates at nodes, with the smallest cap that keeps them tight."""
    spacing = abs(x[1] - x[0]) if len(x) > 1 else abs(y[1] - y[0]) if len(y) > 1 else 0.0
    squared = x[:, None] ** 2 + y**2
    for spacings in range(2, 100):
        cap = max(spacings * spacing, 2 * core_radius)
        rates = (beta[0] ** 2 / np.maximum(squared, cap**2)) ** (beta[1] / 2)
        rates *= 1 + beta[1] / 2 * np.maximum(1 - squared / cap**2, 0.0)
        error = _over_cells(x, y, partial(_collision_curvature, beta=beta, cap=cap))
        below = rates * (1 - _NODE_ROUNDING) - largest_around(np.pad(error, 1)) * spacing**2 / 8
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
    """Bound like `_share_curvature`, of the rate (beta_1 / r)^beta_2 at distances r >= `cap`."""
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

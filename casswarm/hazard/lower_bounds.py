"""Lower bounds of rates, for certificates.

**Of single-agent rates.** With K = 1 / R^2 the capped rate min(1 / r^2, K) is nowhere above
1 / r^2, nor, for R >= `CORE_RADIUS`, above its regularised version (see
`casswarm.hazard.kernels.regular`). Interpolated bilinearly between the corners of a grid cell of
side h, a function f is at most

    e = h^2 / 8 (max f_xx^+ + max f_yy^+)

above itself, each maximum over the cell. For f = 1 / r^2 the second derivatives are f_xx = (6 x^2 -
2 y^2) / r^6 and f_yy = (6 y^2 - 2 x^2) / r^6, at most (6 x_far^2 - 2 y_near^2)^+ / r_near^6 over a
square, and correspondingly for f_yy. A cap only lowers interpolated values, and where the whole
cell is capped there is nothing to correct. Hence the values

    min(1 / r^2, K) - e

at nodes, with e for the square of side 2 h around the node, which contains its four cells: their
bilinear interpolation is nowhere above 1 / r^2. R = 8 h keeps them positive.

**Of a member of a swarm.** In every configuration of n members, a member whose single-agent rate is
b has a rate of at least phi(b). For the paper's saturation, whose density is at most n,

    phi(b) = b (1 + alpha_2) / (1 + alpha_2 n).

With collisions, density has a price. Let h_j in [0, 1] be the density that neighbour j adds, 0 for
one that is lost, S their sum, m = n - 1, g(h) the collision rate at the distance at which the
density is h, which rises with h, and psi a convex function nowhere above g. By Jensen's inequality
the collisions add up to at least m psi(S / m), so that

    phi(b) = min over S in [0, m] of  b (1 + alpha_2) / (1 + alpha_2 (1 + S)) + m psi(S / m).

On each interval [S_k, S_(k+1)] the first term is at least its value at the end and the second at
least its value at the beginning: affine functions of b, whose minimum is below phi. A minimum of
nondecreasing affine functions is concave and nondecreasing, which is what the certificate needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .._util.constants import CORE_RADIUS
from ..typing import FloatArray

CAP = 8.0
"""R in spacings."""

_INTERVALS = 4096
_ROUNDED = 1 - 1e-12
"""Downward by more than all rounding here."""


def cap_radius(spacing: float) -> float:
    """R, the distance to a radar below which the rate counts as if at R."""
    return max(CAP * spacing, CORE_RADIUS)


def inverse_squares_below(
    east: FloatArray, north: FloatArray, spacing: float, radars: FloatArray, strengths: FloatArray
) -> FloatArray:
    """Sum over radars of strength times the node values above, shape (n, m).

    Parameters
    ----------
    east, north : (n,), (m,)
        Coordinates of the nodes.
    spacing : float
        h, the side of a cell.
    radars, strengths : (k, 2), (k,)
    """
    squared_cap = cap_radius(spacing) ** 2
    total = np.zeros((len(east), len(north)))
    for radar, strength in zip(radars, strengths, strict=True):
        distances = [
            np.abs(nodes - center) for nodes, center in zip((east, north), radar, strict=True)
        ]
        at, near, far = (
            [column[:, None] ** 2, row**2]
            for column, row in (
                distances,
                [np.maximum(a - spacing, 0.0) for a in distances],
                [a + spacing for a in distances],
            )
        )
        value = np.maximum(at[0] + at[1], squared_cap)
        np.divide(strength, value, out=value)
        total += value
        curved = np.maximum(6 * far[0] - 2 * near[1], 0.0)
        curved += np.maximum(6 * far[1] - 2 * near[0], 0.0)
        nearest = near[0] + near[1]
        nearest[far[0] + far[1] <= squared_cap] = np.inf
        curved *= strength * spacing**2 / 8
        total -= np.divide(curved, nearest**3, out=curved)
    return total


def least_inverse_squares(
    lower: FloatArray, upper: FloatArray, radars: FloatArray, strengths: FloatArray
) -> FloatArray:
    """Sum over radars of strength times the least 1 / r^2 in a box, (..., 2), (..., 2) to (...)."""
    total = np.zeros(np.broadcast_shapes(lower.shape, upper.shape)[:-1])
    for radar, strength in zip(radars, strengths, strict=True):
        farthest = np.maximum(np.abs(lower - radar), np.abs(upper - radar))
        squared = (farthest**2).sum(axis=-1)
        total += strength / np.maximum(squared, CORE_RADIUS**2)
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
    _ends: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        lines = _lowest(np.asarray(self.intercepts), np.asarray(self.slopes))
        object.__setattr__(self, "intercepts", np.asarray(self.intercepts)[lines])
        object.__setattr__(self, "slopes", np.asarray(self.slopes)[lines])
        fall, rise = -np.diff(self.slopes), np.diff(self.intercepts)
        object.__setattr__(self, "_ends", rise / fall)

    def __call__(self, rates: FloatArray) -> FloatArray:
        """phi at single-agent rates (...), which are not negative."""
        line = np.searchsorted(self._ends, rates)
        return np.asarray(self.intercepts[line] + self.slopes[line] * rates)


def _lowest(intercepts: FloatArray, slopes: FloatArray) -> list[int]:
    """Indices of the lines that are lowest somewhere on b >= 0, steepest first."""
    lines: list[int] = []
    for line in np.lexsort((slopes, intercepts)):
        if lines and slopes[line] >= slopes[lines[-1]]:
            continue  # never below the previous one
        while len(lines) > 1:
            a, b = lines[-2], lines[-1]
            start = (intercepts[b] - intercepts[a]) / (slopes[a] - slopes[b])
            end = (intercepts[line] - intercepts[b]) / (slopes[b] - slopes[line])
            if end > start:
                break
            lines.pop()
        lines.append(int(line))
    return lines


def saturation_least_rate(n: int, alpha_2: float) -> LeastRate:
    """phi of the paper's saturation, with all members at one point."""
    ratio = (1 + alpha_2) / (1 + alpha_2 * n)
    return LeastRate(np.zeros(1), np.array([ratio * _ROUNDED]))


def collision_least_rate(
    n: int, alpha_2: float, collision: Callable[[FloatArray], FloatArray]
) -> LeastRate:
    """phi with collisions; `collision` is g, the collision rate at densities h in (0, 1]."""
    neighbours = n - 1
    if neighbours == 0:
        return saturation_least_rate(n, alpha_2)
    h = np.linspace(0.0, 1.0, _INTERVALS + 1)
    with np.errstate(all="ignore"):
        g = np.nan_to_num(collision(np.maximum(h, 1e-300)), nan=0.0, posinf=1e300)
    g[0] = 0.0
    # on [h_k, h_(k+1)) g is at least g(h_k): the convex hull of the steps' lower right corners
    psi = _convex_below(np.append(0.0, h[1:]), np.append(0.0, g[:-1]))
    density = 1.0 + neighbours * h[1:]
    return LeastRate(
        neighbours * psi[:-1] * _ROUNDED,
        (1 + alpha_2) / (1 + alpha_2 * density) * _ROUNDED,
    )


def _convex_below(x: FloatArray, y: FloatArray) -> FloatArray:
    """The greatest convex function below points of ascending x, at them."""
    hull: list[int] = []
    for point in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            turn = (x[b] - x[a]) * (y[point] - y[a]) - (y[b] - y[a]) * (x[point] - x[a])
            if turn > 0:
                break
            hull.pop()
        hull.append(point)
    return np.asarray(np.interp(x, x[hull], y[hull]))

"""Zones: convex regions with a rate inside, which falls smoothly to zero outside.

The rate is a decreasing function of the distance d to the region, rate * s(d / edge), with
s(u) = (1 - u)^3 (1 + 3 u + 6 u^2), which has two continuous derivatives and is 0 from u = 1 on. It
is written once, as a CasADi expression.

Bounds (``docs/global-guide.md``, Node rates): the distance to a convex set is convex, so the least
rate in a box is at a corner; and as s decreases, no second derivative of the rate along an axis is
above rate max(s'') / edge^2 times the square of that component of the gradient of d.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np

from .._util.threads import locked_cache
from ..typing import Expr, FloatArray
from .codegen import lower
from .rate_bounds import largest_around

_STEEPEST_SLOPE, _MOST_CURVED = 15.0 / 8.0, 10.0 / 3.0**0.5  # largest -s' and s''
_TINY = 1e-8  # of the edge: distances below count as this, so that square roots have derivatives
_ROUNDING = 1e-13  # by more than the rounding of a rate, apart from that of its distance


@dataclass(frozen=True)
class Zone:
    """A convex region that endangers those who enter it.

    Parameters
    ----------
    vertices : m pairs (x, y)
        Corners of a convex polygon, anticlockwise; or a single point.
    radius : float
        The region contains all points within this distance of the polygon or point.
    rate : float
        Rate of a single agent inside, per unit time.
    edge : float
        Distance from the region from which the rate is zero.
    """

    vertices: tuple[tuple[float, float], ...]
    radius: float
    rate: float
    edge: float

    @property
    def center(self) -> tuple[float, float]:
        """Mean of the vertices."""
        x, y = np.mean(self.vertices, axis=0).tolist()
        return x, y

    def distance(self, east: Expr, north: Expr) -> Expr:
        """Distance to the region; 0 inside, or so small that the rate does not differ."""
        squared = self._squared_distance(east, north)
        least = max(self.radius, _TINY * self.edge)
        return ca.sqrt(ca.fmax(squared, least**2)) - self.radius

    def rates(self, east: Expr, north: Expr) -> Expr:
        """Rate of a single agent at points."""
        u = ca.fmin(self.distance(east, north) / self.edge, 1.0)
        return self.rate * (1.0 - u) ** 3 * (1.0 + 3.0 * u + 6.0 * u**2)

    def _squared_distance(self, east: Expr, north: Expr) -> Expr:
        """Squared distance to the polygon or point."""
        first = self.vertices[0]
        if len(self.vertices) == 1:
            return (east - first[0]) ** 2 + (north - first[1]) ** 2
        sides: list[Expr] = []
        squares: list[Expr] = []
        for (x, y), end in zip(self.vertices, (*self.vertices[1:], first), strict=True):
            along = np.subtract(end, (x, y)) / np.hypot(end[0] - x, end[1] - y)
            length = float(np.hypot(end[0] - x, end[1] - y))
            de, dn = east - x, north - y
            part = ca.fmin(ca.fmax(along[0] * de + along[1] * dn, 0.0), length)
            squares.append((de - part * along[0]) ** 2 + (dn - part * along[1]) ** 2)
            sides.append(along[1] * de - along[0] * dn)  # above 0 outside
        return (reduce(ca.fmax, sides) > 0) * reduce(ca.fmin, squares)

    def least_rates(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Least rates in boxes, (..., 2), (..., 2) to (...)."""
        rates = _lowered(self)[1]
        axes = [(lower[..., axis], upper[..., axis]) for axis in (0, 1)]
        corners = [rates(x, y) for x in axes[0] for y in axes[1]]
        least = np.min(corners, axis=0) - self._rounding(lower, upper)
        return np.asarray(np.maximum(least, 0.0))

    def rates_below(self, east: FloatArray, north: FloatArray, spacing: float) -> FloatArray:
        """Values (n, m) at nodes whose bilinear interpolation is nowhere above the rates.

        They are negative where the rate is near zero and convex.
        """
        distance, rates = _lowered(self)
        x, y = east[:, None], north[None]
        middle = [np.append(axis, axis[-1] + spacing) - spacing / 2 for axis in (east, north)]
        u = distance(middle[0][:, None], middle[1][None]) / self.edge  # at the cells' centres
        reach = spacing / self.edge  # more than half a diagonal
        convex = (u > 0.5 - reach) & (u < 1.0 + reach)  # cells where s'' may be positive
        error = self.rate * _MOST_CURVED / 8 * (spacing / self.edge) ** 2
        below = rates(x, y) - error * largest_around(convex.astype(float))
        return np.asarray(below - self._rounding(east, north))

    def _rounding(self, *coordinates: FloatArray) -> float:
        """Bound on the rounding of rates at points with these coordinates."""
        numbers = [np.abs(array).max(initial=0.0) for array in coordinates]
        largest = max(*numbers, float(np.abs(self.vertices).max()), self.radius)
        slope = _STEEPEST_SLOPE * largest / self.edge
        return float(self.rate * _ROUNDING * (1.0 + slope))


@locked_cache(maxsize=64)
def _lowered(zone: Zone) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Distance and rates as NumPy functions."""
    return lower(zone.distance, 2, "distance"), lower(zone.rates, 2, "rates")


def zone_rates(zones: Sequence[Zone], east: Expr, north: Expr) -> Expr:
    """Sum of the rates of zones at points; the number 0 if there are none."""
    return sum((zone.rates(east, north) for zone in zones), 0.0)


def zone_rates_below(
    zones: Sequence[Zone], nodes: tuple[FloatArray, FloatArray, float], below: FloatArray
) -> FloatArray:
    """Values below others plus the rates of zones, as `Zone.rates_below`.

    Where these would be negative, the least rates in the cells around the nodes.
    """
    if not zones:
        return below
    east, north, spacing = nodes
    sharp = below + sum(zone.rates_below(east, north, spacing) for zone in zones)
    if sharp.min() >= 0:
        return np.asarray(sharp)
    grid = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
    around = grid - spacing, grid + spacing
    return np.asarray(below + sum(zone.least_rates(*around) for zone in zones))

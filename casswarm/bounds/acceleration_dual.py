"""Lower bounds for paths with limited acceleration, by multipliers of the limits."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..grid.dynamic_programming import StageCosts, rounding
from ..grid.nodes import corners
from ..typing import BoolArray, FloatArray, IntArray
from .acceleration_kernels import best_path, least_step, tilted_costs_to_come, tilted_costs_to_go
from .acceleration_limits import AccelerationLimits, Region, floored, power_of_two

_CUTS = 60  # linear models of the dual function
_AHEAD = 0.1  # of the distance from the threshold to the best known risk: first level
_SHORTEN, _NO_GAIN = 0.6, 0.01  # of a level that cannot be reached; when to stop
_LONGEST = 1e4  # squared length of a step, relative to that of the multipliers


class Evaluation(NamedTuple):
    """The dual function at some multipliers.

    Parameters
    ----------
    value : float
        Lower bound on the risk of every path in the region; infinite if there is none.
    slope : (n,)
        Of the value with respect to the multipliers.
    path : (T, 2)
        Node indices of the path of least cost.
    """

    value: float
    slope: FloatArray
    path: IntArray


@dataclass(frozen=True, eq=False)
class DualFunction:
    """Least cost of the paths of a region, with multipliers for the limits that they may violate.

    theta of ``docs/global-guide.md``, equation (G8).

    Multipliers are vectors p(t), one for every limit on a second difference, and the multiplier of
    the distance to the target's rim, in one vector (n,). They are risks per length; the unit of
    length is s, the largest step. Limits, costs and distances are rounded outwards (`QUANTUM`).

    Parameters
    ----------
    region : Region
    limits : AccelerationLimits
    scale : float
        A risk that is about the least one.
    """

    region: Region
    limits: AccelerationLimits
    scale: float

    @cached_property
    def _limits(self) -> AccelerationLimits:
        return self.limits.in_steps(self.region.task.step)

    @property
    def _spacing(self) -> float:
        return 1.0 / self.region.reach

    @property
    def count(self) -> int:
        """n, the number of multipliers."""
        return 2 * len(self._bounds) + 1

    @cached_property
    def _bounds(self) -> FloatArray:
        """The limits on the second differences at the steps 0 or 1 to T - 1."""
        later = np.full(self.region.task.steps - 1, self._limits.later)
        free = np.isinf(self._limits.first)
        return later if free else np.concatenate([[self._limits.first], later])

    @cached_property
    def _stage_costs(self) -> StageCosts:
        return StageCosts(self.region.grid, multiplier=1.0)

    @cached_property
    def _windows(self) -> IntArray:
        return np.array([sum(block.nodes, ()) for block in self.region.blocks], np.int64)

    @cached_property
    def _offsets(self) -> IntArray:
        sizes = self._windows[:, 2] * self._windows[:, 3]
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    @cached_property
    def _costs(self) -> FloatArray:
        costs = np.concatenate([costs.ravel() for (costs,) in self._stage_costs.nodes])
        return floored(costs, self.scale)

    @cached_property
    def _rim(self) -> FloatArray:
        """Distance from the target's rim at the nodes of the last step, infinite away from it."""
        rim = self._stage_costs.terminal(self.region.blocks[-1].nodes).ravel()
        return floored(rim / self.region.task.step, 1.0)

    @cached_property
    def _to_go(self) -> FloatArray:
        return np.empty(self._offsets[-1])

    def _prices(self, multipliers: FloatArray) -> FloatArray:
        """p(t) at the steps t = 0 .. T + 1, (T + 2, 2): zero where there is no limit."""
        prices = np.zeros((self.region.task.steps + 2, 2))
        prices[-2 - len(self._bounds) : -2] = multipliers[:-1].reshape(-1, 2)
        return prices

    def _tilts(self, multipliers: FloatArray) -> FloatArray:
        prices = self._prices(multipliers)
        return self._spacing * (prices[:-2] - 2 * prices[1:-1] + prices[2:])

    def _constant(self, multipliers: FloatArray) -> float:
        """What the tilted cost of a path within the limits exceeds its risk by, at most."""
        prices = multipliers[:-1].reshape(-1, 2)
        constant = float(self._bounds @ np.hypot(*prices.T))
        if not np.isinf(self._limits.first):
            constant += float(prices[0] @ self._limits.displacement)
        return constant

    def _slack(self, multipliers: FloatArray, threshold: float) -> float:
        """Bound on the rounding error of costs of at most about `threshold`, a power of two."""
        windows, prices = self._windows, np.abs(self._prices(multipliers))
        far = np.maximum(np.abs(windows[:, :2]), np.abs(windows[:, :2] + windows[:, 2:]))
        weights = prices[:-2] + 2 * prices[1:-1] + prices[2:]
        tilt = self._spacing * float((weights * far).sum())
        size = (
            threshold
            + 3 * tilt
            + abs(self._constant(multipliers))
            + float(self._bounds.sum() * prices.max(initial=0.0))
        )
        multiplier = multipliers[-1] / self.region.task.step
        return 8 * power_of_two(rounding(replace(self._stage_costs, multiplier=multiplier), size))

    def _solve(self, multipliers: FloatArray) -> None:
        ends = np.isfinite(self._rim)
        terminal = np.where(ends, multipliers[-1] * np.where(ends, self._rim, 0.0), np.inf)
        tilts, windows, offsets = self._tilts(multipliers), self._windows, self._offsets
        reach = self.region.reach
        tilted_costs_to_go(self._costs, windows, offsets, tilts, terminal, reach, self._to_go)

    def __call__(self, multipliers: FloatArray) -> Evaluation:
        """The dual function at multipliers (n,), of which the last is at least 0."""
        self._solve(multipliers)
        path = np.zeros((self.region.task.steps, 2), np.int64)
        least = best_path(self._to_go, self._windows, self._offsets, self.region.reach, path)
        if np.isinf(least):
            return Evaluation(math.inf, np.zeros(self.count), path)
        value = least - self._constant(multipliers)
        value -= self._slack(multipliers, max(self.scale, abs(value)))
        return Evaluation(value, self._slope(multipliers, path), path)

    def _slope(self, multipliers: FloatArray, path: IntArray) -> FloatArray:
        positions = self._spacing * np.vstack([[0, 0], path])
        differences = np.diff(positions, 2, axis=0)
        if not np.isinf(self._limits.first):
            differences = np.vstack([positions[1] - self._limits.displacement, differences])
        prices = multipliers[:-1].reshape(-1, 2)
        length, actual = np.hypot(*prices.T), np.hypot(*differences.T)
        at_zero = (
            differences * (1 - np.minimum(1, self._bounds / np.maximum(actual, 1e-300)))[:, None]
        )
        unit = prices / np.where(length > 0, length, 1.0)[:, None]
        slope = np.where(length[:, None] > 0, differences - self._bounds[:, None] * unit, at_zero)
        last = path[-1] - self._windows[-1, :2]
        return np.append(slope.ravel(), self._rim[last[0] * self._windows[-1, 3] + last[1]])

    def kept(self, multipliers: FloatArray, threshold: float) -> Region | None:
        """The part of the region that holds all its paths of less risk than `threshold`."""
        self._solve(multipliers)
        through = np.empty_like(self._to_go)
        tilts = self._tilts(multipliers)
        tilted_costs_to_come(
            self._costs, self._windows, self._offsets, tilts, self.region.reach, through
        )
        through += self._to_go
        limit = threshold + self._constant(multipliers) + self._slack(multipliers, threshold)
        return self.region.restricted(self._masks(through <= limit))

    def _masks(self, nodes: BoolArray) -> Iterator[BoolArray]:
        for step, block in enumerate(self.region.blocks):
            inside = nodes[self._offsets[step] : self._offsets[step + 1]].reshape(block.nodes.shape)
            yield block.cells & np.any(list(corners(inside)), axis=0)


class Ascent(NamedTuple):
    """Outcome of an ascent.

    Parameters
    ----------
    value : float
        Lower bound on the risk of every path in the region.
    multipliers : (n,)
    paths : (m, T, 2)
        The last paths of least cost, in nodes.
    """

    value: float
    multipliers: FloatArray
    paths: FloatArray


def ascend(
    dual: DualFunction,
    multipliers: FloatArray,
    threshold: float,
    best: float,
    iterations: int,
    deadline: float = math.inf,
) -> Ascent:
    """Increase the dual function until it is at least `threshold` or hardly increases.

    A level method: the next multipliers are the nearest to the best so far at which all linear
    models of the concave function reach a level; where there are none, the level is lowered.
    """
    unit = threshold  # of multipliers, and of the dual function
    models = _Models(dual.count)
    top, point = -math.inf, multipliers / unit
    centre, level = point, 1.0 + _AHEAD * max(best / threshold - 1, 1e-9)
    paths: list[IntArray] = []
    for _ in range(iterations):
        value, slope, path = dual(point * unit)
        paths.append(path)
        if value > top * threshold:
            top, centre = value / threshold, point
        if top >= 1.0 or time.monotonic() > deadline:
            break
        models.add(value / threshold, slope, point)
        while (step := models.step_to(level, centre, level - top)) is None:
            level = top + _SHORTEN * (level - top)
            if level - top < _NO_GAIN * (1.0 - top):
                return Ascent(top * threshold, centre * unit, np.array(paths[-12:], float))
        point = centre + step
        point[-1] = max(point[-1], 0.0)
    return Ascent(top * threshold, centre * unit, np.array(paths[-12:], float))


class _Models:
    """Linear functions above a concave one of n variables, and the last variable's sign."""

    def __init__(self, count: int) -> None:
        self._slopes = np.zeros((1, count))
        self._slopes[0, -1] = 1.0
        self._offsets = np.zeros(1)

    def add(self, value: float, slope: FloatArray, point: FloatArray) -> None:
        keep = slice(max(1, len(self._offsets) - _CUTS + 2), None)
        self._slopes = np.vstack([self._slopes[:1], self._slopes[keep], slope])
        offset = value - slope @ point
        self._offsets = np.concatenate([self._offsets[:1], self._offsets[keep], [offset]])

    def step_to(self, level: float, centre: FloatArray, rise: float) -> FloatArray | None:
        """Shortest step from the centre to where all functions reach the level, if it is found."""
        needed = level - self._offsets - self._slopes @ centre
        needed[0] = -centre[-1]
        largest = _LONGEST * max(1.0, float(centre @ centre))
        gram = self._slopes @ self._slopes.T
        found, weights = least_step(gram, needed, 0.1 * rise, largest)
        return self._slopes.T @ weights if found else None

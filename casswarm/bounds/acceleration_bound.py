"""Lower bounds on the risk of guides with limited acceleration: multipliers, branch and bound.

The branches are regions, the paths in given cells at every step.
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from .._util.numbers import SPEED_TOL
from ..grid.dynamic_programming import StageCosts, rounding
from ..grid.nodes import UNIT, CellBlock, Grid, Relaxation, corners, node_count
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray, IntArray
from .acceleration_kernels import best_path, least_step, tilted_costs_to_come, tilted_costs_to_go
from .refinement import Clock, refined

FIRST_NODES = 200_000  # maximum of the first regions, if their cells can be chosen so
MAX_NODES = 5_000_000  # maximum of a region

_FINE_CELLS = 20_000  # of a region, up to which cells are halved before it is divided
_FIRST, _LATER = 4, 60  # iterations of an ascent
_MAX_REACH = 2**20
_DISCARD = 0.5  # of the requested gap: distance of the risk above which paths are discarded

_CUTS = 60  # linear models of the dual function
_AHEAD = 0.1  # of the distance from the threshold to the best known risk: first level
_SHORTEN, _NO_GAIN = 0.6, 0.01  # of a level that cannot be reached; when to stop
_LONGEST = 1e4  # squared length of a step, relative to that of the multipliers
_TIE = 1e-6  # of a cell, by more than the rounding of coordinates
_MIN_GAP = 0.1  # of a block's extent, from which empty lines of cells are a gap

QUANTUM = 2.0**-26
"""Lengths in units of the largest step, and risks in units of about the least one, are rounded
outwards to multiples of it. So the proof does not depend on the last digits of its data, in which
scenarios in different units differ: its search would lead them to different, valid bounds."""


def power_of_two(value: float) -> float:
    """The largest power of two up to a positive value."""
    return 2.0 ** (math.frexp(value)[1] - 1)


def floored(values: FloatArray, scale: float) -> FloatArray:
    """Values rounded down to multiples of `QUANTUM`, relative to about `scale`."""
    quantum = QUANTUM * power_of_two(scale)
    return np.asarray(np.floor(values / quantum) * quantum)


class AccelerationLimits(NamedTuple):
    """Limits on second differences of positions, in units of length.

    Parameters
    ----------
    later : float
        Bound on |X(t+1) - 2 X(t) + X(t-1)|, t >= 1.
    first : float
        Bound on |X(1) - X(0) - `displacement`|; infinite if the first velocity is free.
    displacement : (2,)
        dt V(-1).
    """

    later: float
    first: float
    displacement: FloatArray

    def in_steps(self, step: float) -> AccelerationLimits:
        """The limits in units of the length `step`, rounded outwards to multiples of `QUANTUM`."""

        def bound(length: float) -> float:
            return math.ceil(length * (1 + 8 * UNIT) / QUANTUM) * QUANTUM

        displacement = np.round(self.displacement / step / QUANTUM) * QUANTUM
        first = self.first if math.isinf(self.first) else bound(self.first / step + 2 * QUANTUM)
        return AccelerationLimits(bound(self.later / step), first, displacement)


@dataclass(frozen=True)
class AccelerationBound:
    """A proven lower bound on the risk of the paths that obey the limits of acceleration, too.

    Parameters
    ----------
    bound : float
        No path that obeys the limits of speed and acceleration and ends, by step N, at most
        `radius` from the target's centre has less risk.
    best : float
        Least known risk of such a path.
    radius : float
        In units of length.
    reason : str
        Why the proof ended.
    regions : int
        Number of regions of paths that were bounded.
    seconds : float
        Duration of the proof.
    """

    bound: float
    best: float
    radius: float
    reason: str
    regions: int
    seconds: float

    @property
    def gap(self) -> float:
        """(best - bound) / best."""
        return (self.best - self.bound) / self.best


def acceleration_limits(scenario: Scenario) -> AccelerationLimits:
    """The limits of a scenario's guides, with the chain's tolerance and rounded outwards."""
    dt, swarm = scenario.time.dt, scenario.swarm
    task = Relaxation.from_scenario(scenario)
    extent = float(np.abs([task.start, task.center]).max() + task.steps * task.step)
    excess = SPEED_TOL * swarm.v_max * dt + 64 * UNIT * extent

    def bound(a_max: float) -> float:
        return dt * math.sqrt(a_max) * (1 + 8 * UNIT) + excess

    free = swarm.velocity == "guide" or not scenario.guide.acceleration_limited
    displacement = np.zeros(2) if free else dt * np.asarray(swarm.velocity, float)
    first = math.inf if free else bound(swarm.a_max)
    return AccelerationLimits(bound(scenario.guide_a_max), first, displacement)


@dataclass(frozen=True, eq=False)
class Region:
    """The paths of T steps of which every step is in one of its cells."""

    task: Relaxation  # with T as its number of steps
    reach: int  # k, nodes by which a coordinate changes in a step: the side of a cell is s / k
    blocks: tuple[CellBlock, ...]  # the cells of the steps 1 .. T

    @classmethod
    def full(cls, task: Relaxation, reach: int) -> Region | None:
        """All paths from the start to the target in T steps; None if there are none."""
        blocks = [block for blocks in Grid.full(task, 1, reach).blocks for block in blocks]
        return cls(task, reach, tuple(blocks)) if len(blocks) == task.steps else None

    @property
    def grid(self) -> Grid:
        """The cells as a `Grid` for `StageCosts`: a sample at every step, one block each."""
        return Grid(self.task, 1, self.reach, tuple((block,) for block in self.blocks))

    @property
    def size(self) -> int:
        """Number of cells."""
        return sum(int(np.count_nonzero(block.cells)) for block in self.blocks)

    @property
    def sparse(self) -> bool:
        """True if most nodes of the blocks belong to no cell of the region."""
        return sum(block.nodes.size for block in self.blocks) > 4 * self.size + 1000

    def halved(self) -> Region:
        """Region of the same paths, with cells of half the side."""
        blocks = tuple(block.halved() for block in self.blocks)
        return replace(self, reach=2 * self.reach, blocks=blocks)

    def restricted(self, masks: Iterator[BoolArray]) -> Region | None:
        """The paths in the cells of the masks, one a step; None if a step has none."""
        blocks = []
        for block, mask in zip(self.blocks, masks, strict=True):
            trimmed = CellBlock(block.first, mask).trimmed()
            if trimmed is None:
                return None
            blocks.append(trimmed)
        return replace(self, blocks=tuple(blocks))

    def reached(self, limits: AccelerationLimits) -> Region | None:
        """The paths whose coordinates can be reached from the first velocity, if it is given."""
        if math.isinf(limits.first):
            return self
        speed, h = self.task.step, self.grid.spacing
        faster = limits.first + limits.later * np.arange(self.task.steps)[:, None]
        low = np.maximum(limits.displacement - faster, -speed).cumsum(axis=0) / h - _TIE
        high = np.minimum(limits.displacement + faster, speed).cumsum(axis=0) / h + _TIE

        def masks() -> Iterator[BoolArray]:
            for block, least, most in zip(self.blocks, low, high, strict=True):
                lines = map(np.arange, block.first, block.nodes.last)
                near = [(i + 1 >= a) & (i <= b) for i, a, b in zip(lines, least, most, strict=True)]
                yield block.cells & near[0][:, None] & near[1]

        return self.restricted(masks())

    def parts(self, step: int, axis: int, at: int) -> Iterator[Region]:
        """The paths whose step (from 0) is before the line `at` of its block, and the others."""
        cells = self.blocks[step].cells
        after = np.arange(cells.shape[axis]) >= at
        after = after[:, None] if axis == 0 else after[None]
        for side in (~after, after):
            masks = (cells & side if t == step else b.cells for t, b in enumerate(self.blocks))
            part = self.restricted(masks)
            if part is not None:
                yield part

    def widest_gap(self) -> tuple[int, int, int] | None:
        """Step, axis and line of the widest gap between cells, if there is one."""
        widest, found = 0, None
        for (step, block), axis in product(enumerate(self.blocks), (0, 1)):
            lines = np.flatnonzero(block.cells.any(axis=1 - axis))
            gaps = np.diff(lines, append=lines[-1:] + 1) - 1
            at = int(gaps.argmax())
            if gaps[at] > max(widest, _MIN_GAP * block.cells.shape[axis]):
                widest, found = int(gaps[at]), (step, axis, int(lines[at]) + 1)
        return found

    def halving_line(self, paths: FloatArray) -> tuple[int, int, int] | None:
        """Step, axis and line that separate paths (m, T, 2), in nodes, where they differ most."""
        extent = np.array([block.cells.shape for block in self.blocks])
        if extent.max() < 2:
            return None
        low, high = paths.min(axis=0), paths.max(axis=0)
        score = np.where(extent > 1, np.minimum(high - low, extent) + 1e-3 * extent, -1.0)
        step, axis = (int(i) for i in np.unravel_index(score.argmax(), score.shape))
        count = int(extent[step, axis])
        middle = (low[step, axis] + high[step, axis]) / 2 - self.blocks[step].first[axis]
        margin = max(1, count // 5)
        return step, axis, int(np.clip(round(middle), margin, count - margin))


class Evaluation(NamedTuple):
    """The dual function at some multipliers."""

    value: float  # below the risk of every path in the region; infinite if there is none
    slope: FloatArray  # (n,), of the value with respect to the multipliers
    path: IntArray  # (T, 2), node indices of the path of least cost


@dataclass(frozen=True, eq=False)
class DualFunction:
    """Least cost of the paths of a region, with multipliers for the limits that they may violate.

    theta of ``docs/global-guide.md``, equation (G8).

    Multipliers are vectors p(t), one for every limit on a second difference, and the multiplier of
    the distance to the target's rim, in one vector (n,). They are risks per length; the unit of
    length is s, the largest step. Limits, costs and distances are rounded outwards (`QUANTUM`).
    """

    region: Region
    limits: AccelerationLimits
    scale: float  # a risk that is about the least one

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
        return later if self._free else np.concatenate([[self._limits.first], later])

    @property
    def _free(self) -> bool:
        """True if the first velocity is free."""
        return math.isinf(self._limits.first)

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
        """Most by which the tilted cost of a path within the limits exceeds its risk."""
        prices = multipliers[:-1].reshape(-1, 2)
        constant = float(self._bounds @ np.hypot(*prices.T))
        return constant if self._free else constant + float(prices[0] @ self._limits.displacement)

    def _slack(self, multipliers: FloatArray, threshold: float) -> float:
        """Bound on the rounding error of costs of at most about `threshold`, a power of two."""
        windows, prices = self._windows, np.abs(self._prices(multipliers))
        far = np.maximum(np.abs(windows[:, :2]), np.abs(windows[:, :2] + windows[:, 2:]))
        weights = prices[:-2] + 2 * prices[1:-1] + prices[2:]
        tilt = self._spacing * float((weights * far).sum())
        size = threshold + 3 * tilt + abs(self._constant(multipliers))
        size += float(self._bounds.sum() * prices.max(initial=0.0))
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
        if not self._free:
            differences = np.vstack([positions[1] - self._limits.displacement, differences])
        prices = multipliers[:-1].reshape(-1, 2)
        length, actual = np.hypot(*prices.T)[:, None], np.hypot(*differences.T)[:, None]
        bounds = self._bounds[:, None]
        at_zero = differences * (1 - np.minimum(1, bounds / np.maximum(actual, 1e-300)))
        unit = prices / np.where(length > 0, length, 1.0)
        slope = np.where(length > 0, differences - bounds * unit, at_zero)
        last = path[-1] - self._windows[-1, :2]
        return np.append(slope.ravel(), self._rim[last[0] * self._windows[-1, 3] + last[1]])

    def kept(self, multipliers: FloatArray, threshold: float) -> Region | None:
        """The part of the region that holds all its paths of less risk than `threshold`."""
        self._solve(multipliers)
        through, tilts, reach = (
            np.empty_like(self._to_go),
            self._tilts(multipliers),
            self.region.reach,
        )
        tilted_costs_to_come(self._costs, self._windows, self._offsets, tilts, reach, through)
        through += self._to_go
        limit = threshold + self._constant(multipliers) + self._slack(multipliers, threshold)
        return self.region.restricted(self._masks(through <= limit))

    def _masks(self, nodes: BoolArray) -> Iterator[BoolArray]:
        for step, block in enumerate(self.region.blocks):
            inside = nodes[self._offsets[step] : self._offsets[step + 1]].reshape(block.nodes.shape)
            yield block.cells & np.any(list(corners(inside)), axis=0)


class Ascent(NamedTuple):
    """Outcome of an ascent."""

    value: float  # below the risk of every path in the region
    multipliers: FloatArray  # (n,)
    paths: FloatArray  # (m, T, 2), the last paths of least cost, in nodes


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
                break
        if step is None:
            break
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


@dataclass(order=True)
class _Open:
    """A region that may hold better paths, with the multipliers to begin with."""

    bound: float
    number: int
    region: Region
    multipliers: FloatArray
    iterations: int


class _Search:
    """Best-first search of the regions for one that cannot be bounded by the threshold."""

    def __init__(
        self, limits: AccelerationLimits, threshold: float, best: float, deadline: float
    ) -> None:
        self.limits, self.threshold, self.best = limits, threshold, best
        self.deadline = deadline
        self.open: list[_Open] = []
        self._numbers = itertools.count()

    @property
    def bound(self) -> float:
        """Lower bound on the risk of every path."""
        return min(self.threshold, self.open[0].bound) if self.open else self.threshold

    def add(
        self,
        bound: float,
        region: Region,
        multipliers: FloatArray | None = None,
        iterations: int = _LATER,
    ) -> None:
        """Add a region, below whose bound no path in it is."""
        if multipliers is None:
            multipliers = np.zeros(DualFunction(region, self.limits, self.best).count)
        item = _Open(bound, next(self._numbers), region, multipliers, iterations)
        heapq.heappush(self.open, item)

    def advance(self) -> None:
        """Replace the region of the least bound by the parts of it that may hold better paths."""
        item = heapq.heappop(self.open)
        dual = DualFunction(item.region, self.limits, self.best)
        ascent = ascend(
            dual, item.multipliers, self.threshold, self.best, item.iterations, self.deadline
        )
        bound = max(item.bound, ascent.value)
        if bound >= self.threshold:
            return
        region = dual.kept(ascent.multipliers, self.threshold)
        if region is not None:
            for part in self._parts(item.region, region, ascent.paths):
                self.add(bound, part, ascent.multipliers)

    def _parts(self, before: Region, region: Region, paths: FloatArray) -> list[Region]:
        """Regions to bound next instead of one that was reduced."""
        if region.size < 0.5 * before.size:
            return [region]
        sparse = region.sparse
        if not sparse and 4 * region.size <= _FINE_CELLS:
            return [region.halved()]
        line = (region.widest_gap() if sparse else None) or region.halving_line(paths)
        return [region.halved()] if line is None else list(region.parts(*line))

    def advances(self, gap: float, goal: float) -> Generator[float, None, str]:
        """Bounds after every region, until the goal; why there is no other one."""
        clock = Clock(self.deadline)
        while self.bound < goal:
            clock.check()
            if self.open[0].region.reach > _MAX_REACH:
                return "the gap is not reached with the smallest cells: a better path may exist"
            self.advance()
            yield self.bound
        return f"the gap of {gap:g} is reached"


def bound_with_acceleration(
    task: Relaxation,
    limits: AccelerationLimits,
    best: float,
    *,
    gap: float,
    deadline: float,
    known: float = 0.0,
    first_nodes: int = FIRST_NODES,
) -> AccelerationBound:
    """Bound on the risk of the paths of a relaxation that obey limits of acceleration, too.

    Parameters
    ----------
    task : Relaxation
        With the radius in which paths are to end; its hazard must provide
        `single_agent_rates_below`.
    limits : AccelerationLimits
    best : float
        Risk of a known path; the bound is at most `best`. Any positive number is valid.
    gap : float
        Value of (best - bound) / best at which to stop.
    deadline : float
        A time of `time.monotonic`; a step of the proof that has begun is completed.
    known : float
        A lower bound on the risk of the paths without limits of acceleration.
    first_nodes : int
        Maximum number of nodes of the first regions, if their cells can be chosen so.

    Returns
    -------
    AccelerationBound
        Its bound is at least `known`.
    """
    started = time.monotonic()
    scale = float(floored(np.asarray(best), best))
    search = _Search(limits, (1 - _DISCARD * gap) * scale, scale, deadline)
    reach = 1
    while reach < 64 and node_count(task, 1, 2 * reach) <= first_nodes:
        reach *= 2
    if node_count(task, 1, reach) > MAX_NODES:
        many = f"a step has too many positions: more than {MAX_NODES:,} nodes in all"
        reason, seconds = f"{many}; choose a larger time.dt or a smaller t_f", time.monotonic()
        return AccelerationBound(known, best, task.radius, reason, 0, seconds - started)
    for steps in range(task.steps, 0, -1):
        full = Region.full(replace(task, steps=steps), reach)
        region = None if full is None else full.reached(limits)
        if region is not None:
            search.add(known, region, iterations=_FIRST)
    bounds, reason = refined(search.advances(gap, (1 - gap) * scale), "the time limit is reached")
    bound, seconds = max(known, search.bound), time.monotonic() - started
    return AccelerationBound(bound, best, task.radius, reason, len(bounds), seconds)

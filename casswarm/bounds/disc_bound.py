"""Lower bounds on the risk of paths whose speed is limited in every direction.

Node values W_t are found backwards, so that their bilinear interpolation I W_t is nowhere above the
least cost to go: a bound of second order in the spacing, where rounding paths to nodes gives one of
first order. ``docs/global-guide.md``, Speed in every direction, has the proof and the equations.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.parallel import execute
from ..grid.dynamic_programming import START, StageCosts, rounding
from ..grid.nodes import CellBlock, Grid, NodeBlock, Relaxation, box_extremum
from ..typing import FloatArray, IntArray
from .disc_kernels import least_in_disc
from .refinement import Clock, Level

_MARGIN = 3  # nodes around those that paths visit, for differences of values
_FIRST_REACHES = (4, 2)
_PER_THREAD = 16  # rows
_SIDES = 12  # of the polygon, per node of the reach
_OUTSIDE = 1e-9  # relative distance of the polygon from the disc, for the rounding of points
_ON_NODE = 1e-11  # of a cell
_LEAST_MULTIPLIER = 0.25
_STARTS = 4  # of a step's length, the radius of the cost of the distance from the start
_OPERATIONS = 16  # rounding errors of a step, in those of a visit of a grid


class DiscMoves(NamedTuple):
    """Where the least value of a bilinear interpolation in a polygon around a disc may be.

    At a node in it, or on its boundary, which is cut into pieces of a cell each. Parameters are
    those of `least_in_disc`.
    """

    nodes: IntArray
    points: tuple[IntArray, IntArray, FloatArray]
    pieces: tuple[IntArray, FloatArray]
    margin: int

    @classmethod
    @lru_cache(maxsize=8)
    def within(cls, reach: int) -> DiscMoves:
        """Moves of at most `reach` nodes in every direction."""
        sides, radius, margin = 4 * (_SIDES * reach // 4), reach * (1 + _OUTSIDE), reach + 2
        axis = np.arange(-reach - 1, reach + 2)
        grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        normals = _directions(np.arange(sides), sides)
        inside = (grid @ normals.T).max(axis=1) <= radius
        corners = _directions(np.arange(sides) + 0.5, sides) * radius / math.cos(math.pi / sides)
        ends = [corners[:1]]
        ends += [_cut(*side) for side in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
        points = np.vstack(ends)
        steps = np.diff(points, axis=0, prepend=points[:1])
        cells = np.floor(points - steps / 2).astype(int)
        counts, places, weights = _interpolation(points)
        return cls(
            grid[inside] + margin,
            (counts, places + margin, weights),
            (cells + margin, steps.prod(axis=1)),
            margin,
        )

    def least(self, values: FloatArray, at: NodeBlock, to: NodeBlock) -> FloatArray:
        """Least interpolated values around the nodes `to`, of values at the nodes `at`."""
        near = to.grown(self.margin)
        padded, common = np.full(near.shape, np.inf), near.common(at)
        padded[common.within(near)] = values[common.within(at)]
        out, scratch = np.empty(to.shape), np.empty((to.shape[0], 2, to.shape[1]))
        arguments = padded, self.nodes, self.points, self.pieces, scratch, out
        execute(least_in_disc, len(out), arguments, _PER_THREAD)
        return out


def _directions(numbers: ArrayLike, count: int) -> FloatArray:
    angles = 2 * math.pi / count * np.asarray(numbers, float)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _cut(begin: FloatArray, end: FloatArray) -> FloatArray:
    """Points (m, 2) at which a side enters another cell, and its end."""
    places = [np.ones(1)]
    for a, b in zip(begin.tolist(), end.tolist(), strict=True):
        lines = np.arange(math.ceil(min(a, b)), math.floor(max(a, b)) + 1)
        if abs(b - a) > _ON_NODE:
            places.append((lines - a) / (b - a))
    cuts = np.unique(np.concatenate(places))
    cuts = cuts[(cuts > _ON_NODE) & (cuts <= 1.0)]
    apart = np.append(np.diff(cuts) > _ON_NODE, True)
    return np.asarray(begin + cuts[apart][:, None] * (end - begin))


def _interpolation(points: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Counts (P,), nodes (P, 4, 2) and positive weights (P, 4) of bilinear interpolation."""
    nearest = np.rint(points)
    points = np.where(np.abs(points - nearest) <= _ON_NODE, nearest, points)
    cells = np.floor(points)
    fractions = points - cells
    ends = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
    parts = np.where(ends, fractions[:, None], 1 - fractions[:, None])
    weights = parts.prod(axis=-1)
    order = np.argsort(weights == 0, axis=1, kind="stable")
    places = (cells[:, None] + ends).astype(int)
    places = np.take_along_axis(places, order[..., None], axis=1)
    return (weights > 0).sum(axis=1), places, np.take_along_axis(weights, order, axis=1)


def convexity_excess(values: FloatArray) -> FloatArray:
    """By how much values (n, m) are lowered so that a second interpolation is not above the first.

    For moves by any fraction of a cell; 0 where values are concave. Values are finite, and
    differences that need others outside are left out.
    """
    along = [np.zeros_like(values) for _ in range(3)]
    along[0][1:-1] = np.diff(values, 2, axis=0)
    along[1][:, 1:-1] = np.diff(values, 2, axis=1)
    along[2][1:-1, 1:-1] = np.diff(along[0], 2, axis=1)[1:-1]
    largest = [
        _largest(np.maximum(difference, 0.0), reach)
        for difference, reach in zip(along, ((0, 1), (1, 0), (0, 0)), strict=True)
    ]
    return _largest(largest[0] / 4 + largest[1] / 4 + largest[2] / 16, (1, 1))


def _largest(values: FloatArray, reach: tuple[int, int]) -> FloatArray:
    block = NodeBlock((0, 0), values.shape)
    return box_extremum(values, block, block, reach, largest=True)


@dataclass(frozen=True, eq=False)
class DiscProgram:
    """The dynamic program on nodes of a spacing of s / `reach`.

    The nodes are the same after every step: where fewer are within reach, values would rise so
    steeply that no bound is left.

    Parameters
    ----------
    task : Relaxation
    reach : int
    best : float
        Risk of a known path.
    multiplier : float
        Positive, of the arrival; every value is valid.
    box : NodeBlock
        Nodes between which all paths are that may be better than the known one.
    steps : int
        Number of steps after which such a path has arrived.
    """

    task: Relaxation
    reach: int
    best: float
    multiplier: float
    box: NodeBlock
    steps: int

    @classmethod
    def full(cls, task: Relaxation, reach: int, best: float, multiplier: float) -> DiscProgram:
        """The program for all paths to the target in time."""
        blocks = itertools.chain.from_iterable(Grid.full(task, 1, reach).nodes)
        box = NodeBlock.hull([*blocks, START])
        return cls(task, reach, best, multiplier, box, task.steps)

    @cached_property
    def nodes(self) -> NodeBlock:
        """The nodes of the box, and some around it."""
        return self.box.grown(_MARGIN)

    @property
    def size(self) -> int:
        """Number of node values, over all steps."""
        return self.nodes.size * self.steps

    @cached_property
    def costs(self) -> StageCosts:
        """Costs of visits to the nodes."""
        blocks = ((CellBlock.full(self.nodes),),) * self.steps
        return StageCosts(Grid(self.task, 1, self.reach, blocks))

    @cached_property
    def visits(self) -> list[FloatArray]:
        """Costs of visits to the nodes after every step, at most the known risk.

        A path with a more expensive one is no better; and beside radars, costs are very convex.
        """
        return [np.minimum(costs, self.best) for (costs,) in self.costs.nodes]

    def _beyond(self, center: FloatArray, radius: float) -> FloatArray:
        """About the distance from a circle, 0 or less inside when interpolated, but smooth."""
        h = self.costs.grid.spacing
        axes = zip(self.costs.grid.axes(self.nodes), center, strict=True)
        east, north = ((x - c) ** 2 for x, c in axes)
        squared = east[:, None] + north - h**2 / 2
        return np.asarray((squared - radius**2) / (2 * radius))

    @cached_property
    def to_go(self) -> list[FloatArray]:
        """W_t at the nodes after every step t, without the cost of their visit, and W_0 (1, 1).

        Paths may stop anywhere, at a cost that is at most 0 in the target zone.
        """
        moves, task = DiscMoves.within(self.reach), self.task
        stopping = self.multiplier * self._beyond(task.center, task.radius)
        found = [stopping]
        for step in reversed(range(self.steps)):
            values = self.visits[step] + found[-1]
            values -= convexity_excess(values)
            if step == 0:
                found.append(moves.least(values, self.nodes, START))
            else:
                found.append(np.minimum(moves.least(values, self.nodes, self.nodes), stopping))
        return found[::-1]

    @cached_property
    def bound(self) -> float:
        """No path of the task has less risk: W_0 at the start, less rounding errors."""
        pairs = zip(self.to_go[1:], self.visits, strict=True)
        largest = max(float((np.abs(to_go) + visit).max()) for to_go, visit in pairs)
        return float(self.to_go[0][0, 0]) - self._rounding(largest)

    def _rounding(self, largest: float) -> float:
        """Bound on rounding errors of costs up to the largest one, and of points on lines."""
        lines = 10 * _ON_NODE * self.steps * largest
        return lines + _OPERATIONS * rounding(self.costs, largest)

    def halved(self) -> DiscProgram:
        """The program of half the spacing, without steps and nodes that no better path visits.

        The costs to come are found forwards as those to go, from a cost of the distance from the
        start that is 0 there.
        """
        moves, nodes = DiscMoves.within(self.reach), self.nodes
        near = self.task.step / _STARTS
        come = self.multiplier * self._beyond(self.task.start, near)
        come += self.multiplier * near / 2  # 0 at the start, at most
        errors = self._rounding(float(np.abs(come).max()) + self.steps * self.best)
        used, steps = np.zeros(nodes.shape, bool), 0
        for step in range(self.steps):
            come = moves.least(come - convexity_excess(come), nodes, nodes) + self.visits[step]
            active = come + self.to_go[step + 1] <= self.best + errors
            if not active.any():
                break
            used, steps = used | active, step + 1
        used[-nodes.first[0], -nodes.first[1]] = True  # the start
        lines = [np.flatnonzero(used.any(axis=1 - axis)) for axis in (0, 1)]
        first, last = (np.add(nodes.first, [line[end] for line in lines]) for end in (0, -1))
        box = NodeBlock.between(2 * (first - 1), 2 * (last + 1))
        return replace(self, reach=2 * self.reach, box=box, steps=steps)


def disc_levels(
    task: Relaxation,
    bound: float,
    best: float,
    multiplier: float,
    gap: float,
    max_nodes: int,
    clock: Clock,
) -> Generator[Level, None, str]:
    """Grids whose spacing is halved, each with the bound so far; why there is no other one.

    `bound` is known before. The multiplier is at least a part of the mean risk per length, so that
    stopping elsewhere costs.
    """
    multiplier = max(multiplier, _LEAST_MULTIPLIER * best / (task.steps * task.step))
    programs = (DiscProgram.full(task, k, best, multiplier) for k in _FIRST_REACHES)
    program = next((each for each in programs if each.size <= max_nodes), None)
    if program is None:
        return f"the first grid has more than {max_nodes:,} nodes"
    DiscMoves.within(1).least(np.zeros((1, 1)), START, START)  # compiles, before the time is taken
    clock.begin()
    while program.size <= max_nodes:
        bound = max(bound, min(best, program.bound))
        spacing = program.costs.grid.spacing
        yield Level(1, program.reach, spacing, program.size, bound, clock.seconds)
        if bound >= (1 - gap) * best:
            return f"the gap of {gap:g} is reached"
        finer = program.halved()
        if not finer.steps:
            return "the remaining gap is within rounding errors"
        clock.begin(2 * finer.size / program.size)
        program = finer
    return f"the next grid has more than {max_nodes:,} nodes"

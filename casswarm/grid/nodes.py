"""Grids of the relaxed guide problem: nodes per step, in rectangular blocks of nodes and cells."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .._util.numbers import SPEED_TOL
from ..hazard import Hazard
from ..hazard.rate_bounds import LeastRate
from ..motion.kinematics import remaining_distance
from ..scenario import Scenario
from ..scenario.sections import Disc
from ..typing import BoolArray, FloatArray, IntArray
from .extremum_kernels import LANES, running_extremum

UNIT = 2.0**-53  # unit roundoff of a double

ANYWHERE = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])  # starts: all points of the plane

_MAX_REACH = 64
_RECTANGLES = 24  # that cover a disc of nodes
_MIN_ACTIVE = 0.5  # active fraction of a block's cells below which it is split
_MIN_CELLS = 256  # blocks of at most so many cells are not split
_NO_WEIGHT = 1e-6  # at most so much weight may be due to the rounding of positions


Window: TypeAlias = tuple[int, ...]
"""Numbers of nodes within reach along each axis."""


class NodeBlock(NamedTuple):
    """A rectangular block of nodes, along any number of axes.

    Parameters
    ----------
    first : tuple of int
        Indices of the first node.
    shape : tuple of int
        Number of nodes along each axis.
    """

    first: tuple[int, ...]
    shape: tuple[int, ...]

    @classmethod
    def between(cls, first: ArrayLike, last: ArrayLike) -> NodeBlock:
        """Nodes between two of them, both included; none if one index of the last is less."""
        low, high = (np.asarray(node).astype(int) for node in (first, last))
        return cls(tuple(low.tolist()), tuple(np.maximum(high - low + 1, 0).tolist()))

    @classmethod
    def hull(cls, blocks: Iterable[NodeBlock]) -> NodeBlock:
        """The smallest block that holds all of some."""
        first, last = zip(*((block.first, block.last) for block in blocks), strict=True)
        return cls.between(np.min(first, axis=0), np.max(last, axis=0))

    @property
    def last(self) -> tuple[int, ...]:
        """Indices of the last node."""
        return tuple(i + n - 1 for i, n in zip(self.first, self.shape, strict=True))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)

    def along(self, axes: slice) -> NodeBlock:
        """The block along some of the axes."""
        return NodeBlock(self.first[axes], self.shape[axes])

    def common(self, other: NodeBlock) -> NodeBlock:
        """Nodes that both blocks hold."""
        first, last = np.maximum(self.first, other.first), np.minimum(self.last, other.last)
        return NodeBlock.between(first, last)

    def grown(self, reach: int | Window) -> NodeBlock:
        """All nodes within reach, along every axis or along each."""
        each = (reach,) * len(self.first) if isinstance(reach, int) else reach
        first = tuple(i - k for i, k in zip(self.first, each, strict=True))
        return NodeBlock(first, tuple(n + 2 * k for n, k in zip(self.shape, each, strict=True)))

    def within(self, outer: NodeBlock) -> tuple[slice, ...]:
        """Slices of these nodes in the arrays of a block that holds them."""
        starts = (i - j for i, j in zip(self.first, outer.first, strict=True))
        return tuple(slice(i, i + n) for i, n in zip(starts, self.shape, strict=True))


class CellBlock(NamedTuple):
    """A rectangle of cells, some of them active.

    Parameters
    ----------
    first : pair of int
        Indices of the first node; node (0, 0) is the start.
    cells : (n-1, m-1) bool
        Active cells, between n x m nodes.
    """

    first: tuple[int, ...]
    cells: BoolArray

    @classmethod
    def full(cls, nodes: NodeBlock) -> CellBlock:
        """All cells of a block; nodes on one line have cells on one side of it."""
        return cls(nodes.first, np.ones(tuple(max(n - 1, 1) for n in nodes.shape), bool))

    @property
    def nodes(self) -> NodeBlock:
        """All nodes of the rectangle."""
        return NodeBlock(self.first, (self.cells.shape[0] + 1, self.cells.shape[1] + 1))

    @property
    def visited(self) -> BoolArray:
        """Mask of the nodes that are corners of active cells."""
        mask = np.zeros(self.nodes.shape, bool)
        for corner in corners(mask):
            np.logical_or(corner, self.cells, out=corner)
        return mask

    def trimmed(self) -> CellBlock | None:
        """Block without the lines of inactive cells at its sides; None if no cell is active."""
        lines = [np.flatnonzero(self.cells.any(axis=1 - axis)).tolist() for axis in (0, 1)]
        if not lines[0]:
            return None
        first = tuple(i + found[0] for i, found in zip(self.first, lines, strict=True))
        return CellBlock(first, self.cells[*(slice(at[0], at[-1] + 1) for at in lines)])

    def halved(self) -> CellBlock:
        """Block of the same cells, with half the spacing."""
        cells = self.cells.repeat(2, axis=0).repeat(2, axis=1)
        return CellBlock(tuple(2 * i for i in self.first), cells)


def corners(nodes: np.ndarray) -> Iterator[np.ndarray]:
    """The four corners of every cell, as views (n-1, m-1) of node values (n, m)."""
    ends = slice(None, -1), slice(1, None)
    return (nodes[corner] for corner in itertools.product(ends, ends))


def _split(block: CellBlock) -> Iterator[CellBlock]:
    """Blocks that hold all active cells, and few others."""
    trimmed = block.trimmed()
    if trimmed is None:
        return
    (row, column), cells = trimmed
    if cells.size <= _MIN_CELLS or np.count_nonzero(cells) >= _MIN_ACTIVE * cells.size:
        yield trimmed
        return
    axis = int(cells.shape[1] > cells.shape[0])
    empty = np.flatnonzero(~cells.any(axis=1 - axis))  # preferably at a gap
    middle = cells.shape[axis] // 2
    at = int(empty[np.abs(empty - middle).argmin()]) if empty.size else middle
    before, after = np.split(cells, [at], axis=axis)
    yield from _split(CellBlock((row, column), before))
    yield from _split(CellBlock((row + at * (1 - axis), column + at * axis), after))


def box_extremum(
    values: FloatArray, at: NodeBlock, to: NodeBlock, reach: int | Window, *, largest: bool = False
) -> FloatArray:
    """Least value within reach along every axis, or the largest one.

    `scipy.ndimage.minimum_filter` gives the same numbers but takes several times as long.

    Parameters
    ----------
    values : ndarray
        At the nodes `at`, in the shape of that block.
    at, to : NodeBlock
        Nodes of the values and of the result, along the same axes.
    reach : int or tuple of int
        Number of nodes along every axis, or along each.
    largest : bool
        Whether to take the largest value instead of the least.

    Returns
    -------
    ndarray
        At the nodes `to`, in the shape of that block. Positions outside, where no node of `at` is
        within reach, are filled with infinity, or with -infinity for the largest value; so with a
        reach of 0 it is the values, embedded.
    """
    each = (reach,) * len(at.shape) if isinstance(reach, int) else reach
    near = to.grown(each).common(at)
    if 0 in near.shape:
        return np.full(to.shape, -np.inf if largest else np.inf)
    values = np.ascontiguousarray(values[near.within(at)])
    for axis in reversed(range(values.ndim)):
        shape = values.shape
        if each[axis] == 0 and shape[axis] == to.shape[axis]:
            continue  # nothing to compare with
        split = math.prod(shape[:axis]), shape[axis], math.prod(shape[axis + 1 :])
        out = np.empty((*shape[:axis], to.shape[axis], *shape[axis + 1 :]))
        scratch = np.empty((2, shape[axis], LANES))
        first = to.first[axis] - near.first[axis]
        running_extremum(values.ravel(), split, first, each[axis], largest, out.ravel(), scratch)
        values = out
    return values


def extremum_within_reach(
    sources: Sequence[FloatArray],
    blocks: Sequence[NodeBlock],
    to: NodeBlock,
    reach: int | Window,
    *,
    largest: bool = False,
) -> FloatArray:
    """Least (or largest) value at the nodes of any block within reach of each of the nodes `to`."""
    combine, best = np.maximum if largest else np.minimum, None
    for values, block in zip(sources, blocks, strict=True):
        found = box_extremum(values, block, to, reach, largest=largest)
        best = found if best is None else combine(best, found, out=best)
    return np.full(to.shape, -np.inf if largest else np.inf) if best is None else best


def extremum_in_windows(
    sources: Sequence[FloatArray],
    blocks: Sequence[NodeBlock],
    to: NodeBlock,
    windows: Sequence[Window],
    *,
    largest: bool = False,
) -> FloatArray:
    """Least (or largest) value at the nodes of any block in any window around each of `to`."""
    combine = np.maximum if largest else np.minimum
    best = extremum_within_reach(sources, blocks, to, windows[0], largest=largest)
    for window in windows[1:]:
        other = extremum_within_reach(sources, blocks, to, window, largest=largest)
        combine(best, other, out=best)
    return best


def multilinear(values: FloatArray, cells: IntArray, fractions: FloatArray) -> FloatArray:
    """Interpolation (B,) of values along N axes in cells (B, N), at fractions (B, N) of a cell.

    Infinite outside the grid, and where a corner is whose weight is not zero up to rounding.
    """
    inside = np.asarray(((cells >= 0) & (cells < np.array(values.shape) - 1)).all(axis=1))
    if not inside.any():
        return np.full(len(cells), np.inf)
    cells = np.where(inside[:, None], cells, 0)
    interpolated = np.zeros(len(cells))
    for ends in itertools.product((0, 1), repeat=values.ndim):
        weight = math.prod(np.where(ends, fractions, 1 - fractions).T)
        corner = values[tuple((cells + ends).T)]
        interpolated += weight * np.where((weight > _NO_WEIGHT) | np.isfinite(corner), corner, 0.0)
    return np.where(inside, interpolated, np.inf)


@dataclass(frozen=True, eq=False)
class Relaxation:
    """A scenario's guide problem with the speed limit, the horizon and the target only.

    With ``time.substeps``, its steps are the parts of the scenario's.

    Without acceleration limits and arrival margin, with the excess of speed that the chain allows,
    and with the rest rounded outwards: a lower bound for all guides of the relaxation is one for
    all guides of the scenario, and for every member of a swarm.

    Parameters
    ----------
    hazard : Hazard
    start, center : (2,)
        Positions of the start and of the target zone's centre.
    radius : float
        Of the target zone, in units of length; a guide arrives at its first step in the zone.
    step, speed : float
        s, the largest change of a coordinate in a time step, and a velocity that is never reduced.
    steps, dt : int, float
        N, the last time step, and the length of one.
    least : LeastRate, optional
        phi of the single-agent rate b, the least rate of a member of a swarm, instead of that rate.
    disc : bool
        Whether s bounds the length of a step, too.
    """

    hazard: Hazard
    start: FloatArray
    center: FloatArray
    radius: float
    step: float
    speed: float
    steps: int
    dt: float
    least: LeastRate | None = None
    disc: bool = False

    @classmethod
    def from_scenario(
        cls, scenario: Scenario, start: FloatArray | None = None, target: Disc | None = None
    ) -> Relaxation:
        """Relaxation of a scenario's guide problem, from its guide's start or from `start` (2,).

        To its first target zone, or to another one. Where members differ, the agent is at least as
        safe and fast as any.
        """
        scenario = scenario.by_parts.most_favourable
        begin = scenario.guide_start if start is None else np.asarray(start, float)
        target = scenario.target if target is None else target
        center = np.asarray(target.center, float)
        v_max, dt = scenario.swarm.v_max, scenario.time.dt
        step = v_max * dt
        extent = float(np.abs([begin, center]).max() + scenario.n_steps * step)
        rounding = 8 * UNIT  # of sums, products and hypot in paths computed in doubles
        return cls(
            hazard=scenario.hazard,
            start=np.array(begin),
            center=center,
            radius=target.radius * (1 + rounding) + rounding * extent,
            step=step * (1 + SPEED_TOL + rounding) + rounding * extent,
            speed=v_max * (1 + SPEED_TOL - rounding),
            steps=scenario.n_steps,
            dt=dt,
            disc=scenario.swarm.speed == "disc",
        )

    @property
    def bounded(self) -> bool:
        """True if the hazard provides lower bounds of its rates."""
        return self.after(1).hazard.single_agent_lower_bound(self.start, self.start) is not None

    def after(self, step: int) -> Relaxation:
        """The relaxation with the rates after so many steps as those of all times."""
        hazard = self.hazard.after(step)
        return self if hazard is self.hazard else replace(self, hazard=hazard)

    def reachable(self, positions: FloatArray, steps: int) -> BoolArray:
        """Test if the target can be reached from positions (..., 2) in `steps` steps."""
        distance = remaining_distance(positions, self.center, steps * self.step)
        return np.asarray(distance <= self.radius)

    def rates_along(self, points: FloatArray) -> FloatArray:
        """Rates (T, ...) at points (T, ..., 2) after 1..T steps."""
        rates = self.hazard.rates_along(points)
        return rates if self.least is None else self.least(rates)

    def rates(self, points: FloatArray) -> FloatArray:
        """Rates (...) at points (..., 2)."""
        rates = self.hazard.single_agent_rates(points)
        return rates if self.least is None else self.least(rates)

    def rates_below(self, east: FloatArray, north: FloatArray, spacing: float) -> FloatArray | None:
        """Node values as of `Hazard.single_agent_rates_below`, below `rates`.

        With phi = `least`, b the single-agent rate, v its node values and I their bilinear
        interpolation: I v <= b, and phi is concave and nondecreasing, so that I phi(v) <= phi(I v)
        <= phi(b) if all v are at least 0. Otherwise v are lower bounds over the cells around nodes.
        """
        below = self.hazard.single_agent_rates_below(east, north, spacing)
        if below is None or self.least is None:
            return below
        if (below < 0).any():
            nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
            bound = self.hazard.single_agent_lower_bound(nodes - spacing, nodes + spacing)
            assert bound is not None
            below = np.maximum(bound, 0.0)
        return self.least(below)


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes start + h (i, j) for every sample of a path.

    Parameters
    ----------
    task : Relaxation
    stride : int
        m, time steps from one sample of a path to the next.
    reach : int
        k, nodes by which a coordinate changes from one sample to the next: h = m s / k.
    blocks : tuple of tuple of CellBlock
        For every sample 1 .. ceil(N / m) of a path, the blocks that it may visit.
    """

    task: Relaxation
    stride: int
    reach: int
    blocks: tuple[tuple[CellBlock, ...], ...] = field(repr=False)

    @classmethod
    def full(
        cls, task: Relaxation, stride: int, reach: int, starts: FloatArray | None = None
    ) -> Grid:
        """All nodes on paths to the target in time, from `starts` (n, 2) or the task's start."""
        ranges = zip(*np.array(_ranges(task, stride, reach, starts), int), strict=True)
        blocks = tuple(
            (CellBlock.full(NodeBlock.between(first, last)),) if (first <= last).all() else ()
            for first, last in ranges
        )
        return cls(task, stride, reach, blocks)

    @classmethod
    def finest(cls, task: Relaxation, max_nodes: int, starts: FloatArray | None = None) -> Grid:
        """The finest full grid of at most `max_nodes` nodes, with a stride above 1 if necessary."""
        stride = reach = 1
        while node_count(task, stride, 1, starts) > max_nodes and stride < task.steps:
            stride *= 2
        while reach < _MAX_REACH and node_count(task, stride, 2 * reach, starts) <= max_nodes:
            reach *= 2
        return cls.full(task, stride, reach, starts)

    @property
    def spacing(self) -> float:
        """h, the side of a cell."""
        return self.stride * self.task.step / self.reach

    @cached_property
    def windows(self) -> tuple[Window, ...]:
        """Rectangles around a node that hold all nodes of the next sample within reach."""
        return disc_windows(self.reach) if self.task.disc else ((self.reach, self.reach),)

    @property
    def size(self) -> int:
        """Number of nodes over all samples."""
        return sum(nodes.size for blocks in self.nodes for nodes in blocks)

    @cached_property
    def nodes(self) -> tuple[tuple[NodeBlock, ...], ...]:
        """The nodes of every block."""
        return tuple(tuple(block.nodes for block in blocks) for blocks in self.blocks)

    def axes(self, nodes: NodeBlock) -> tuple[FloatArray, FloatArray]:
        """Coordinates of the nodes of a block, along each axis."""
        east, north = (
            origin + self.spacing * (first + np.arange(count))
            for origin, first, count in zip(self.task.start, *nodes, strict=True)
        )
        return east, north

    def restricted(self, active: tuple[tuple[BoolArray, ...], ...]) -> Grid:
        """The active cells of every block, with the same spacing."""
        blocks = tuple(
            tuple(
                part
                for block, cells in zip(blocks, masks, strict=True)
                for part in _split(CellBlock(block.first, cells))
            )
            for blocks, masks in zip(self.blocks, active, strict=True)
        )
        return replace(self, blocks=blocks)

    def halved(self, active: tuple[tuple[BoolArray, ...], ...]) -> Grid:
        """The active cells of every block with half the spacing, and half the stride if above 1."""
        blocks = tuple(
            tuple(
                fine
                for block, cells in zip(blocks, masks, strict=True)
                for fine in _split(CellBlock(block.first, cells).halved())
            )
            for blocks, masks in zip(self.blocks, active, strict=True)
        )
        if self.stride == 1:
            return replace(self, reach=2 * self.reach, blocks=blocks)
        stride = self.stride // 2
        twice = tuple(fine for fine in blocks for _ in (0, 1))
        return replace(self, stride=stride, blocks=twice[: -(-self.task.steps // stride)])


def disc_windows(reach: int) -> tuple[Window, ...]:
    """Rectangles that hold the nodes (i, j) to which a disc of radius k = `reach` leads.

    Rounding to nodes adds less than a spacing to each component of a move, so that they are at most
    k + sqrt(2) away; ``docs/global-guide.md``, Speed in every direction.
    """
    radius = (reach + math.sqrt(2)) * (1 + 1e-12)
    ends = radius * np.sin(np.linspace(0.0, math.pi / 4, _RECTANGLES // 2 + 1))[1:]
    tops = sorted({min(reach, int(end)) for end in ends})
    rows: dict[int, int] = {}  # tops by width, the highest of each
    first = 0
    for top in tops:  # rows from `first` to `top` are at most as wide as the first of them
        rows[min(reach, int(math.sqrt(radius**2 - first**2)))] = top
        first = top + 1
    # beyond the diagonal, columns for rows: quarter turns and mirrors change nothing
    return tuple(dict.fromkeys([*rows.items(), *((top, width) for width, top in rows.items())]))


def node_count(task: Relaxation, stride: int, reach: int, starts: FloatArray | None = None) -> int:
    """Number of nodes of `Grid.full`, without building it."""
    first, last = _ranges(task, stride, reach, starts)
    return int(np.maximum(last - first + 1, 0).prod(axis=1).sum())  # of floats: it may be huge


def _ranges(
    task: Relaxation, stride: int, reach: int, starts: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """First and last nodes (N, 2) of every sample, within reach of the starts and the target."""
    spacing = stride * task.step / reach
    samples = -(-task.steps // stride)
    out = reach * np.arange(1, samples + 1)[:, None]
    back = out[::-1] - reach
    far = task.radius + (stride - 1) * task.step
    offsets = ((task.start[None] if starts is None else starts) - task.start) / spacing
    low, high = ((task.center + side - task.start) / spacing for side in (-far, far))
    return (
        np.maximum(np.floor(low) - back, np.floor(offsets.min(axis=0)) - out),
        np.minimum(np.ceil(high) + back, np.ceil(offsets.max(axis=0)) + out),
    )

"""Grids of the relaxed guide problem: nodes per step, in rectangular blocks of cells."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ...hazard import Hazard
from ...typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from ...scenario import Scenario

Ranges: TypeAlias = Iterator[tuple[np.ndarray, np.ndarray]]
"""First and last node of every sample."""

UNIT = 2.0**-53
"""Unit roundoff of a double."""

_FULL = 0.5  # of a block's cells that are active: below, it is split
_SMALL = 256  # cells of a block that is not split


@dataclass(frozen=True, eq=False)
class Relaxation:
    """What every guide of a scenario obeys, rounded outwards: speed, horizon and target alone.

    Neither the limits of acceleration nor the margin of arrival: a lower bound for all guides of
    the relaxation is one for all guides of the scenario.

    Parameters
    ----------
    hazard : Hazard
    start, center : (2,)
    radius : float
        Of the target zone; a guide has arrived at its first step in it.
    step : float
        s, the most by which a coordinate changes in a time step.
    steps : int
        N, the last time step.
    dt : float
    """

    hazard: Hazard
    start: FloatArray
    center: FloatArray
    radius: float
    step: float
    steps: int
    dt: float

    @classmethod
    def of(cls, scenario: Scenario, start: FloatArray | None = None) -> Relaxation:
        """Relaxation of a scenario's guide problem, or of that of an agent elsewhere."""
        begin = scenario.guide_start if start is None else np.asarray(start, float)
        center = np.asarray(scenario.target.center, float)
        step = scenario.swarm.v_max * scenario.time.dt
        extent = float(max(np.abs(begin).max(), np.abs(center).max()) + scenario.n_steps * step)
        rounding = 8 * UNIT  # of sums, products and hypot in paths computed in doubles
        return cls(
            hazard=scenario.hazard,
            start=np.array(begin),
            center=center,
            radius=scenario.target.radius * (1 + rounding) + rounding * extent,
            step=step * (1 + rounding) + rounding * extent,
            steps=scenario.n_steps,
            dt=scenario.time.dt,
        )

    @property
    def extent(self) -> float:
        """Greatest absolute coordinate that a guide can have."""
        far = np.maximum(np.abs(self.start), np.abs(self.center))
        return float(far.max() + self.steps * self.step)


class Block(NamedTuple):
    """A rectangle of cells, and its nodes.

    Parameters
    ----------
    low : pair of int
        Indices of the first node; node (0, 0) is the start.
    cells : (n-1, m-1) bool
        Which cells are active.
    """

    low: tuple[int, int]
    cells: BoolArray

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of nodes."""
        return self.cells.shape[0] + 1, self.cells.shape[1] + 1

    @property
    def nodes(self) -> BoolArray:
        """Which nodes are corners of active cells."""
        found = np.zeros(self.shape, bool)
        for corner in corners(found):
            np.logical_or(corner, self.cells, out=corner)
        return found

    @property
    def high(self) -> tuple[int, int]:
        """Indices of the last node."""
        return self.low[0] + self.cells.shape[0], self.low[1] + self.cells.shape[1]


def corners(nodes: np.ndarray) -> Iterator[np.ndarray]:
    """The four corners of every cell, as views (n-1, m-1) of node values (n, m)."""
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            yield nodes[rows, columns]


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes start + h (i, j) for every sample of a path.

    Parameters
    ----------
    task : Relaxation
    merged : int
        m, time steps from one sample of a path to the next.
    reach : int
        k, nodes by which a coordinate changes from one sample to the next: h = m s / k.
    blocks : tuple of tuple of Block
        For every sample j = 1 .. ceil(N / m) of a path, the blocks that it may visit.
    """

    task: Relaxation
    merged: int
    reach: int
    blocks: tuple[tuple[Block, ...], ...] = field(repr=False)

    @classmethod
    def whole(cls, task: Relaxation, merged: int, reach: int) -> Grid:
        """All nodes that can be reached in time and from which the target can be."""
        return cls._of_ranges(task, merged, reach, _ranges(task, merged, reach))

    @classmethod
    def everywhere(cls, task: Relaxation, reach: int) -> Grid:
        """All nodes from which the target can be reached in time, wherever the start is."""
        return cls._of_ranges(task, 1, reach, _ranges(task, 1, reach, from_start=False))

    @classmethod
    def around(cls, task: Relaxation, starts: FloatArray, most: int) -> Grid:
        """As `whole`, of paths from any of `starts` (n, 2): the finest of at most `most` nodes.

        Steps are merged where they must be.
        """

        def ranges(merged: int, reach: int) -> list[tuple[np.ndarray, np.ndarray]]:
            apart = (starts - task.start) * (reach / (merged * task.step))
            spread = (np.floor(apart.min(axis=0)), np.ceil(apart.max(axis=0)))
            return [
                (
                    np.maximum(low, spread[0].astype(int) - out),
                    np.minimum(high, spread[1].astype(int) + out),
                )
                for out, (low, high) in zip(
                    itertools.count(reach, reach),
                    _ranges(task, merged, reach, from_start=False),
                    strict=False,
                )
            ]

        def size(merged: int, reach: int) -> int:
            return int(
                sum(np.prod(np.maximum(high - low + 1, 0)) for low, high in ranges(merged, reach))
            )

        merged = reach = 1
        while size(merged, 1) > most and merged < task.steps:
            merged *= 2
        while reach < 64 and size(merged, 2 * reach) <= most:
            reach *= 2
        return cls._of_ranges(task, merged, reach, iter(ranges(merged, reach)))

    @classmethod
    def _of_ranges(cls, task: Relaxation, merged: int, reach: int, ranges: Ranges) -> Grid:
        blocks = tuple(
            ()
            if (high < low).any()
            else (
                Block(
                    (int(low[0]), int(low[1])),
                    np.ones(tuple(np.maximum(high - low, 1)), bool),
                ),
            )
            for low, high in ranges
        )
        return cls(task, merged, reach, blocks)

    @property
    def spacing(self) -> float:
        """h, the side of a cell."""
        return self.merged * self.task.step / self.reach

    @property
    def size(self) -> int:
        """Nodes, over all samples."""
        return sum(math.prod(block.shape) for blocks in self.blocks for block in blocks)

    def axes(self, low: tuple[int, int], shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Coordinates of nodes from `low` on."""
        east, north = (
            place + self.spacing * (first + np.arange(count))
            for place, first, count in zip(self.task.start, low, shape, strict=True)
        )
        return east, north

    def halved(self, active: tuple[tuple[BoolArray, ...], ...]) -> Grid:
        """Half the spacing, on the active cells of every block alone; half the steps merged."""
        blocks = tuple(
            tuple(
                fine
                for block, cells in zip(blocks, masks, strict=True)
                for fine in _split(
                    (2 * block.low[0], 2 * block.low[1]),
                    cells.repeat(2, axis=0).repeat(2, axis=1),
                )
            )
            for blocks, masks in zip(self.blocks, active, strict=True)
        )
        if self.merged == 1:
            return replace(self, reach=2 * self.reach, blocks=blocks)
        merged = self.merged // 2
        twice = tuple(fine for fine in blocks for _ in (0, 1))
        return replace(self, merged=merged, blocks=twice[: -(-self.task.steps // merged)])


def whole_size(task: Relaxation, merged: int, reach: int, from_start: bool = True) -> int:
    """`Grid.size` of the whole grid, or of that of all starts, without building it."""
    return int(
        sum(
            np.prod(np.maximum(high - low + 1, 0))
            for low, high in _ranges(task, merged, reach, from_start)
        )
    )


def _ranges(task: Relaxation, merged: int, reach: int, from_start: bool = True) -> Ranges:
    """First and last nodes of every sample."""
    spacing = merged * task.step / reach
    samples = -(-task.steps // merged)
    far = task.radius + (merged - 1) * task.step
    first = np.floor((task.center - far - task.start) / spacing).astype(int)
    last = np.ceil((task.center + far - task.start) / spacing).astype(int)
    for sample in range(1, samples + 1):
        out, back = sample * reach, (samples - sample) * reach
        low, high = first - back, last + back
        yield (np.maximum(low, -out), np.minimum(high, out)) if from_start else (low, high)


def _split(low: tuple[int, int], cells: BoolArray) -> Iterator[Block]:
    """Blocks that hold all active cells, and not many others."""
    rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    if not rows.size:
        return
    cells = cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    low = (low[0] + int(rows[0]), low[1] + int(columns[0]))
    if cells.size <= _SMALL or np.count_nonzero(cells) >= _FULL * cells.size:
        yield Block(low, cells)
        return
    axis = int(cells.shape[1] > cells.shape[0])
    empty = np.flatnonzero(~cells.any(axis=1 - axis))  # a gap is the best place
    middle = cells.shape[axis] // 2
    at = int(empty[np.abs(empty - middle).argmin()]) if empty.size else middle
    first, second = np.split(cells, [at], axis=axis)
    yield from _split(low, first)
    yield from _split((low[0] + at * (1 - axis), low[1] + at * axis), second)

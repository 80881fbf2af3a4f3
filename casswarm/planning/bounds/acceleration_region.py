"""Regions of paths with a prescribed number of steps: cells that each step may be in."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...typing import BoolArray, FloatArray
from .acceleration_limits import AccelerationLimits
from .grid import Block, Grid, Relaxation

_TIE = 1e-6  # of a cell, by more than the rounding of coordinates
_MIN_GAP = 0.1  # of a block's extent, from which empty lines of cells are a gap


@dataclass(frozen=True, eq=False)
class Region:
    """The paths of T steps of which every step is in one of its cells.

    Parameters
    ----------
    task : Relaxation
        With T as its number of steps.
    reach : int
        k, nodes by which a coordinate changes in a step: the side of a cell is s / k.
    blocks : tuple of Block
        The cells of the steps 1 .. T.
    """

    task: Relaxation
    reach: int
    blocks: tuple[Block, ...]

    @classmethod
    def full(cls, task: Relaxation, reach: int) -> Region | None:
        """All paths from the start to the target in T steps; None if there are none."""
        blocks = [block for blocks in Grid.full(task, 1, reach).blocks for block in blocks]
        return cls(task, reach, tuple(blocks)) if len(blocks) == task.steps else None

    @property
    def grid(self) -> Grid:
        """The nodes, as of other bounds."""
        return Grid(self.task, 1, self.reach, tuple((block,) for block in self.blocks))

    @property
    def size(self) -> int:
        """Number of cells."""
        return sum(int(np.count_nonzero(block.cells)) for block in self.blocks)

    @property
    def sparse(self) -> bool:
        """Whether most nodes of the blocks belong to no cell of the region."""
        return sum(math.prod(block.shape) for block in self.blocks) > 4 * self.size + 1000

    def halved(self) -> Region:
        """The same paths, with cells of half the side."""
        blocks = tuple(
            Block((2 * i, 2 * j), cells.repeat(2, axis=0).repeat(2, axis=1))
            for (i, j), cells in self.blocks
        )
        return replace(self, reach=2 * self.reach, blocks=blocks)

    def restricted(self, masks: Iterator[BoolArray]) -> Region | None:
        """The paths in the cells of the masks, one a step; None if a step has none."""
        blocks = []
        for (i, j), mask in zip((block.low for block in self.blocks), masks, strict=True):
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            if not rows.size:
                return None
            cells = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            blocks.append(Block((i + int(rows[0]), j + int(columns[0])), cells))
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
                lines = map(np.arange, block.low, block.high)
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
        for step, block in enumerate(self.blocks):
            for axis in (0, 1):
                lines = np.flatnonzero(block.cells.any(axis=1 - axis))
                if lines.size < 2:
                    continue
                gaps = np.diff(lines) - 1
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
        middle = (low[step, axis] + high[step, axis]) / 2 - self.blocks[step].low[axis]
        margin = max(1, count // 5)
        return step, axis, int(np.clip(round(middle), margin, count - margin))

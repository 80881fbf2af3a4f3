"""Limits of acceleration of guides, and the regions of paths that obey them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from .._util.numbers import SPEED_TOL
from ..grid.nodes import UNIT, CellBlock, Grid, Relaxation
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray

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
    """Limits on second differences of positions.

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
    reason : str
        Why the proof ended.
    regions : int
        Number of regions of paths that were bounded.
    seconds : float
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


_TIE = 1e-6  # of a cell, by more than the rounding of coordinates
_MIN_GAP = 0.1  # of a block's extent, from which empty lines of cells are a gap


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
        """The nodes, as of other bounds."""
        return Grid(self.task, 1, self.reach, tuple((block,) for block in self.blocks))

    @property
    def size(self) -> int:
        """Number of cells."""
        return sum(int(np.count_nonzero(block.cells)) for block in self.blocks)

    @property
    def sparse(self) -> bool:
        """Whether most nodes of the blocks belong to no cell of the region."""
        return sum(block.nodes.size for block in self.blocks) > 4 * self.size + 1000

    def halved(self) -> Region:
        """The same paths, with cells of half the side."""
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

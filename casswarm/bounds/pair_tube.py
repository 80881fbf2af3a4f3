"""Positions that two members may visit, step by step, as rectangular blocks of the joint grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from .._util.numbers import SPEED_TOL
from ..grid.nodes import NodeBlock, Relaxation
from ..typing import BoolArray, FloatArray, IntArray
from .pair_kernels import project

_SPLIT = 0.75  # a block is split if both parts have at most this fraction of its nodes
_MIN_NODES = 20_000  # of a block that is split
_PAIRS = tuple(combinations(range(4), 2))


def nodes_of_box(box: FloatArray, spacing: float) -> NodeBlock:
    """Nodes, along four axes, of the cells that meet the box (2, 4) of both members' coordinates.

    Every node of the first member is in it with every node of the second: see `members`.
    """
    low = np.floor(box[0] / spacing)
    return NodeBlock.between(low, np.maximum(np.ceil(box[1] / spacing), low + 1))


def members(block: NodeBlock) -> tuple[NodeBlock, NodeBlock]:
    """The nodes of either member in a block of both."""
    return block.along(slice(2)), block.along(slice(2, 4))


@dataclass(frozen=True, eq=False)
class Tube:
    """Positions of both members, relative to the first one's start, that are worth a visit.

    `retreat` are the corners of a rectangle: beyond it, a member is out of reach of the target by
    more than a margin.
    """

    boxes: tuple[FloatArray, ...]  # (b, 2, 4), for steps 0 to N: lower and upper coordinates
    retreat: FloatArray  # (N+1, 2, 2)
    leaving: BoolArray  # (N, 2): whether member i may leave it between steps t and t + 1

    @classmethod
    def full(
        cls,
        task: Relaxation,
        starts: FloatArray,
        margin: float,
        velocities: FloatArray,
        change: float,
    ) -> Tube:
        """All positions within reach of the starts, and almost within reach of the target.

        The members have initial `velocities` (2, 2), and change them by at most `change` in a step.
        """
        steps = np.arange(task.steps + 1)[:, None]
        slack = task.radius + (task.steps - steps) * task.step + margin
        center = task.center - task.start
        retreat = np.stack([center - slack, center + slack], axis=1)
        origin = (starts - task.start).ravel()
        change = min(change * (1 + SPEED_TOL) + SPEED_TOL * task.speed, 4 * task.speed)
        excess = task.step - task.speed * task.dt  # rounding
        low, high = (task.dt * (velocities.ravel() + sign * change * steps) for sign in (-1, 1))
        low, high = np.maximum(low - excess, -task.step), np.minimum(high + excess, task.step)
        low[0] = high[0] = 0.0
        low = np.maximum(origin + np.cumsum(low, axis=0), np.tile(retreat[:, 0], 2))
        high = np.minimum(origin + np.cumsum(high, axis=0), np.tile(retreat[:, 1], 2))
        low[0] = high[0] = origin  # even beyond the rectangle, which such a member then leaves
        boxes = tuple(np.stack([low, high], axis=1)[:, None])
        return cls(boxes, retreat, np.ones((task.steps, 2), bool))

    def departed(self) -> Tube:
        """No positions but the starts: members leave the rectangle in the first step."""
        empty = np.zeros((0, 2, 4))
        return replace(self, boxes=(self.boxes[0], *(empty for _ in self.boxes[1:])))

    def blocks(self, spacing: float) -> list[list[NodeBlock]]:
        """Nodes of the boxes, for every step."""
        return [[nodes_of_box(box, spacing) for box in boxes] for boxes in self.boxes]

    def nodes(self, spacing: float) -> int:
        """Number of nodes of all blocks."""
        return sum(block.size for blocks in self.blocks(spacing) for block in blocks)


def gathered(
    task: Relaxation, starts: FloatArray, margin: float, largest_margin: float
) -> FloatArray:
    """Starts (2, 2), of which those beyond the rectangle of step 0 are moved to its edge.

    They are beyond that of the largest margin, and moved to that of `margin`. Such a member never
    arrives and never protects one that does from less than either away. At the edge it can leave in
    the first step, so the value there is at least that without it. It is moved as near to the other
    one as possible, which keeps the grid small.
    """
    slack = task.radius + task.steps * task.step
    offsets = starts - task.center
    limit = (slack + largest_margin) * (1 + 1e-9)
    outside = np.abs(offsets) > limit
    gone = np.asarray(outside.any(axis=1))[:, None]
    moved = np.where(gone, 0.0, offsets)
    for member in np.flatnonzero(gone):
        axis = int(outside[member].argmax())
        moved[member] = moved[1 - member]
        moved[member, axis] = math.copysign(slack + margin, offsets[member, axis])
    return np.where(gone, task.center + moved, starts)


def viable_boxes(needed: FloatArray, block: NodeBlock, spacing: float) -> Iterator[FloatArray]:
    """Boxes (2, 4) of all cells around the nodes of a block that are not -infinity."""
    for low, high in _split(needed, np.zeros(4, int)):
        yield np.asarray(spacing * (np.stack([low - 1, high + 1]) + block.first), float)


def _split(needed: FloatArray, origin: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
    """First and last nodes of parts of an array that hold all values above -infinity."""
    shadows = [np.zeros((needed.shape[a], needed.shape[b]), bool) for a, b in _PAIRS]
    project(needed, *shadows)
    shadow = dict(zip(_PAIRS, shadows, strict=True))
    shadow |= {(b, a): values.T for (a, b), values in shadow.items()}
    lines = [np.flatnonzero(shadow[axis, (axis + 1) % 4].any(axis=1)) for axis in range(4)]
    if not lines[0].size:
        return
    low, high = (np.array([line[end] for line in lines]) for end in (0, -1))
    size = math.prod((high - low + 3).tolist())
    cut = _best_cut(shadow, low, high) if size > _MIN_NODES else None
    if cut is None or cut[0] > _SPLIT * size:
        yield origin + low, origin + high
        return
    _, axis, at = cut
    for part in (slice(low[axis], at), slice(at, high[axis] + 1)):
        slices = [slice(a, b + 1) for a, b in zip(low, high, strict=True)]
        slices[axis] = part
        yield from _split(needed[tuple(slices)], origin + [s.start for s in slices])


def _best_cut(
    shadow: dict[tuple[int, int], BoolArray], low: IntArray, high: IntArray
) -> tuple[float, int, int] | None:
    """Nodes of two parts, axis and first node of the second part, of the best cut."""
    best: tuple[float, int, int] | None = None
    for axis in np.flatnonzero(high > low).tolist():
        cuts = np.arange(low[axis] + 1, high[axis] + 1)
        sizes = cuts - low[axis] + 2.0, high[axis] - cuts + 3.0
        for other in {0, 1, 2, 3} - {axis}:
            rows = shadow[axis, other]
            ahead = np.logical_or.accumulate(rows, axis=0)[cuts - 1]
            behind = np.logical_or.accumulate(rows[::-1], axis=0)[::-1][cuts]
            for part, found in zip(sizes, (ahead, behind), strict=True):
                np.multiply(part, _extents(found) + 2, out=part)
        total = sizes[0] + sizes[1]
        at = int(total.argmin())
        if best is None or total[at] < best[0]:
            best = float(total[at]), axis, int(cuts[at])
    return best


def _extents(found: BoolArray) -> IntArray:
    """Number of nodes from the first to the last found one in every row."""
    first, last = found.argmax(axis=1), found.shape[1] - 1 - found[:, ::-1].argmax(axis=1)
    return np.where(found.any(axis=1), last - first + 1, 0)

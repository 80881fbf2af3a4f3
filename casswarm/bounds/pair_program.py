"""Backward and forward recursions of two members on the blocks of a tube.

The proof is in ``docs/two-members.md``.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..grid.node_blocks import NodeBlock, extremum_within_reach
from ..grid.nodes import Relaxation
from ..typing import BoolArray, FloatArray
from .pair_nodes import PairLattice, pair_lattice
from .pair_tube import Tube, members, viable_boxes

if TYPE_CHECKING:
    from .pair_kernels import MemberNodes, PairNodes

_NO_WEIGHT = 1e-6  # at most so much weight may be due to the rounding of positions
_LEAST = float(np.finfo(float).tiny)  # of values, so that none is 0 by underflow
_ROUNDED_UP = 1 + 1e-10  # by more than weights and logarithms are rounded

Arrays = list[FloatArray]
"""Values (n1, m1, n2, m2) at the nodes of every block of a step."""


@dataclass(frozen=True, eq=False)
class PairProgram:
    """The dynamic program of two members on one grid.

    Parameters
    ----------
    task : Relaxation
        It starts at the first member.
    starts : (2, 2)
        Those of members that can never arrive are moved: see `gathered`.
    tube : Tube
    reach : int
        Nodes by which a coordinate changes in a step: the spacing is s / reach.
    margin : float
        Of the tube, in units of length.
    multipliers : pair of float or None
        Of arrival, of a single agent and of both; None for values without bounds.
    """

    task: Relaxation
    starts: FloatArray
    tube: Tube
    reach: int
    margin: float
    multipliers: tuple[float, float] | None

    @property
    def spacing(self) -> float:
        """h, the side of a cell."""
        return self.task.step / self.reach

    @cached_property
    def blocks(self) -> list[list[NodeBlock]]:
        """Blocks of steps 0 to N."""
        return self.tube.blocks(self.spacing)

    @cached_property
    def region(self) -> NodeBlock:
        """All nodes that either member visits."""
        blocks = [block for blocks in self.blocks for block in blocks]
        return NodeBlock.hull(nodes for block in blocks for nodes in members(block))

    @cached_property
    def size(self) -> int:
        """Number of values in memory: of the joint nodes, or of `lattice` if it has more."""
        n, m = self.region.shape
        of_lattice = 3 * (self.task.steps + 1) * n * m + 8 * (2 * n - 1) * (2 * m - 1)
        return max(self.tube.nodes(self.spacing), of_lattice)

    @cached_property
    def lattice(self) -> PairLattice:
        """Functions on the nodes of each member."""
        margin = int(self.margin / self.spacing)
        return pair_lattice(
            self.task, self.starts, self.reach, self.region, margin, self.multipliers
        )

    def backward(self, deadline: float = math.inf) -> tuple[float, list[Arrays]]:
        """Upper bound of the optimal value, and values of steps 1 to N before losses are drawn.

        Raises
        ------
        TimeoutError
            It is not complete at the `deadline`, a time of `time.monotonic`.
        """
        from .pair_kernels import step_back

        values = [np.zeros(block.shape) for block in self.blocks[-1]]
        kept: list[Arrays] = []
        for step in reversed(range(self.task.steps)):
            if time.monotonic() > deadline:
                raise TimeoutError
            following = self.blocks[step + 1]
            for array, block in zip(values, following, strict=True):
                step_back(*self._nodes(step + 1, block), array)
            kept.append(values)
            values = [
                np.maximum(self._largest(values, following, block), _LEAST)
                for block in self.blocks[step]
            ]
            for array, block in zip(values, self.blocks[step], strict=True):
                self._let_leave(step, block, array)
        return self._at_starts(values[0], self.blocks[0][0]), kept[::-1]

    def forward(self, kept: list[Arrays], known: float, deadline: float = math.inf) -> Tube:
        """The tube of the policies of success above `known`; `kept` is from `backward`.

        Raises
        ------
        TimeoutError
            As `backward`.
        """
        from .pair_kernels import discard, step_forward

        needed = [np.full(block.shape, -known) for block in self.blocks[0]]
        boxes, leaving = [self.tube.boxes[0]], np.zeros_like(self.tube.leaving)
        for step in range(self.task.steps):
            if time.monotonic() > deadline:
                raise TimeoutError
            for array, block in zip(needed, self.blocks[step], strict=True):
                leaving[step] |= self._may_leave(step, block, array)
            found, following = [], self.blocks[step + 1]
            last, needed = needed, []
            for block, values, box in zip(
                following, kept[step], self.tube.boxes[step + 1], strict=True
            ):
                array = self._largest(last, self.blocks[step], block)
                discard(array.ravel(), values.ravel())
                for viable in viable_boxes(array, block, self.spacing):
                    viable[0], viable[1] = (
                        np.maximum(viable[0], box[0]),
                        np.minimum(viable[1], box[1]),
                    )
                    found.append(viable)
                step_forward(*self._nodes(step + 1, block), array)
                needed.append(array)
            boxes.append(np.array(found).reshape(-1, 2, 4))
        return Tube(tuple(boxes), self.tube.retreat, leaving)

    def _largest(self, values: Arrays, blocks: list[NodeBlock], to: NodeBlock) -> FloatArray:
        """Largest value within reach of any block's nodes; -infinity where there is none."""
        return extremum_within_reach(values, blocks, to, self.reach, largest=True)

    def _nodes(
        self, step: int, block: NodeBlock
    ) -> tuple[MemberNodes, MemberNodes, PairNodes, tuple[int, int]]:
        """Arguments of kernels for a block."""
        lattice = self.lattice
        first, second = (lattice.member(step, nodes) for nodes in members(block))
        return first, second, lattice.pair, lattice.offset(*members(block))

    def _leavers(self, step: int, nodes: NodeBlock) -> BoolArray:
        """Nodes (n, m) from which a member may leave the tube's rectangle."""
        low = np.ceil(self.tube.retreat[step + 1, 0] / self.spacing) + self.reach
        high = np.floor(self.tube.retreat[step + 1, 1] / self.spacing) - self.reach
        x, y = (np.arange(a, b + 1) for a, b in zip(nodes.first, nodes.last, strict=True))
        leavers = ((x <= low[0]) | (x >= high[0]))[:, None] | (y <= low[1]) | (y >= high[1])
        return np.asarray(leavers)

    def _guarded(self, step: int, nodes: NodeBlock) -> FloatArray:
        return np.asarray(self.lattice.guarded[step][nodes.within(self.lattice.region)])

    def _let_leave(self, step: int, block: NodeBlock, values: FloatArray) -> None:
        """Raise values where a member leaves to what the other one can then have at most."""
        first, second = members(block)
        if self.tube.leaving[step, 0]:
            leavers = self._leavers(step, first)[..., None, None]
            np.maximum(values, self._guarded(step, second), out=values, where=leavers)
        if self.tube.leaving[step, 1]:
            leavers = self._leavers(step, second)
            guarded = self._guarded(step, first)[..., None, None]
            np.maximum(values, guarded, out=values, where=leavers)

    def _may_leave(self, step: int, block: NodeBlock, needed: FloatArray) -> BoolArray:
        """Members (2,) for which it can pay to leave from some node of a block."""
        result = self.tube.leaving[step].copy()
        first, second = members(block)
        if result[0]:
            leavers = self._leavers(step, first)
            result[0] = (-needed[leavers] <= self._guarded(step, second)).any()
        if result[1]:
            leavers = self._leavers(step, second)
            guarded = self._guarded(step, first)[..., None]
            result[1] = (-needed[:, :, leavers] <= guarded).any()
        return np.asarray(result)

    def _at_starts(self, values: FloatArray, block: NodeBlock) -> float:
        """Geometric interpolation of the values of step 0 at the starts; the first is a node."""
        i, j = -block.first[0], -block.first[1]
        at = (self.starts[1] - self.task.start) / self.spacing - block.first[2:]
        total = 0.0
        for k in (0, 1):
            for m in (0, 1):
                weight = abs(1 - k - at[0]) * abs(1 - m - at[1])
                value = float(values[i, j, k, m])
                if value > _LEAST or weight > _NO_WEIGHT:
                    total += weight * math.log(value)
        return max(math.exp(total), _LEAST) * _ROUNDED_UP

"""The dynamic program of two members, on rectangular blocks of the positions that they may visit.

The proof is in ``docs/two-members.md``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .._util.numbers import SPEED_TOL
from ..grid.dynamic_programming import StageCosts, backwards, costs_to_go, least_cost
from ..grid.nodes import UNIT, Grid, NodeBlock, Relaxation, extremum_within_reach
from ..hazard import Hazard
from ..typing import BoolArray, FloatArray, IntArray
from .pair_kernels import MemberNodes, PairNodes, discard, project, step_back, step_forward

_MULTIPLIER_NODES = 50_000
_LARGEST_ARRIVAL = 300.0  # product of multiplier and radius: its exponential does not overflow
_NO_WEIGHT = 1e-6  # at most so much weight may be due to the rounding of positions
_LEAST = float(np.finfo(float).tiny)  # of values, so that none is 0 by underflow
_ROUNDED_UP = 1 + 1e-10  # by more than weights and logarithms are rounded

Arrays = list[FloatArray]
"""Values (n1, m1, n2, m2) at the nodes of every block of a step."""

_SPLIT = 0.75  # a block is split if both parts have at most this fraction of its nodes
_MIN_NODES = 20_000  # of a block that is split
_PAIRS = tuple(combinations(range(4), 2))


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

    def blocks(self, spacing: float) -> list[list[NodeBlock]]:
        """Nodes of the cells that meet the boxes, for every step; of a box, along four axes.

        Every node of the first member is in it with every node of the second: see `members`.
        """

        def nodes(box: FloatArray) -> NodeBlock:
            low = np.floor(box[0] / spacing)
            return NodeBlock.between(low, np.maximum(np.ceil(box[1] / spacing), low + 1))

        return [[nodes(box) for box in boxes] for boxes in self.boxes]

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


StepRisks = tuple[FloatArray, FloatArray, FloatArray]
"""Risk (n, m), slopes (2, n, m) and spread (n, m) of a step, as of `MemberNodes`."""


@dataclass(frozen=True, eq=False)
class PairLattice:
    """Functions on the nodes x_1(0) + h (i, j), for both members, and on their differences."""

    grid: Grid  # of a single agent, from either start
    region: NodeBlock  # all nodes that either member visits
    risks: tuple[StepRisks, ...]  # of steps 1 to N
    alone: FloatArray  # (N+1, n, m), as of `MemberNodes` at steps 0 to N
    floor: FloatArray  # with the multiplier of arrival of a pair
    guarded: FloatArray  # of an agent that an immortal one out of reach of the target protects
    pair: PairNodes

    def member(self, step: int, nodes: NodeBlock) -> MemberNodes:
        """Functions on the nodes of one member after step `step`, from 1."""
        at = nodes.within(self.region)
        risk, slopes, spread = self.risks[step - 1]
        arrays = risk[at], slopes[:, *at], spread[at], self.alone[step][at], self.floor[step][at]
        return MemberNodes(*map(np.ascontiguousarray, arrays))

    def offset(self, first: NodeBlock, second: NodeBlock) -> tuple[int, int]:
        """Index in `pair` of the difference of the first nodes of two blocks."""
        center = np.array(self.pair.share.shape) // 2
        i, j = center + first.first - np.array(second.first)
        return int(i), int(j)


def pair_lattice(
    task: Relaxation,
    starts: FloatArray,
    reach: int,
    region: NodeBlock,
    margin: int,
    multipliers: tuple[float, float] | None,
) -> PairLattice:
    """All node functions for a spacing of s / `reach`; `margin` is that of `guarded`, in nodes.

    Without `multipliers` of arrival, of an agent and of a pair, they are no bounds: rates are those
    at the nodes.
    """
    grid, certified = Grid.full(task, 1, reach, starts), multipliers is not None
    deepest = task.radius + grid.spacing**2 / (4 * task.radius)  # by which costs of arrival fall
    largest_arrival = 2 * _LARGEST_ARRIVAL / deepest
    multiplier, of_pair = (min(each, largest_arrival) for each in multipliers or (0.0, 0.0))
    single = StageCosts(grid, certified, multiplier, inside=not certified)
    both = single.with_multiplier(of_pair)
    exact = 1.0 - _rounding(task, grid.spacing) if certified else 1.0
    n, m = region.shape
    bounds = task.hazard.pair_bounds((n, m), grid.spacing, certified)
    assert bounds is not None
    share, collision = bounds.share, exact * task.dt * bounds.collision
    least, largest = (_windows(collision, combine) for combine in (np.minimum, np.maximum))
    spans, pair_slopes, pair_spread = (
        values * certified for values in (_around(largest - least), *_variation(share))
    )
    lows = _around(least, np.minimum)
    pair = PairNodes(share, pair_slopes, pair_spread, collision, lows, spans)
    row, column = np.array(share.shape) // 2
    guarded = max(  # it increases outwards
        float(share[min(row + margin, 2 * row), column]),
        float(share[row, min(column + margin, 2 * column)]),
    )
    alone, floor, with_guard = (
        lone_values(costs, region, factor, exact)
        for costs, factor in ((single, 1.0), (both, 1.0), (both, guarded))
    )
    risks = _step_risks(grid, region, exact, certified)
    return PairLattice(grid, region, risks, alone, floor, with_guard, pair)


def _step_risks(
    grid: Grid, region: NodeBlock, exact: float, certified: bool
) -> tuple[StepRisks, ...]:
    """Risks of steps 1 to N; steps with the same rates have the same arrays."""
    inner, found = (slice(1, -1), slice(1, -1)), dict[Hazard, StepRisks]()
    hazards = [grid.task.hazard.after(step + 1) for step in range(grid.task.steps)]
    for step, hazard in enumerate(hazards, 1):
        if hazard not in found:
            task = grid.task.after(step)
            risk = task.dt * _rates(task, grid, region, certified) * exact
            slopes, spread = (values * certified for values in _variation(risk))
            found[hazard] = risk[inner], slopes[:, *inner], spread[inner]
    return tuple(found[hazard] for hazard in hazards)


def lone_values(costs: StageCosts, region: NodeBlock, share: float, exact: float) -> FloatArray:
    """Upper bounds (N+1, n, m) of the probability that an agent arrives, from every node.

    Its risk is `share` times that of a single agent. The cost of arrival is not scaled.
    """
    grid = costs.grid
    out = np.zeros((len(grid.blocks) + 1, *region.shape))
    samples, first = reversed(range(len(grid.blocks))), list[FloatArray]()
    for sample, (after, values) in zip(samples, backwards(costs, share * exact), strict=True):
        for nodes, to_go in zip(grid.nodes[sample], after, strict=True):
            common = nodes.common(region)
            out[sample + 1][common.within(region)] = _survival(to_go[common.within(nodes)])
        first = values
    out[0] = _survival(extremum_within_reach(first, grid.nodes[0], region, grid.reach))
    return out


def _survival(risk: FloatArray) -> FloatArray:
    """exp(-risk), rounded up by more than the rounding of sums of risks and terminal costs.

    It is positive, if only just, wherever the target is within reach.
    """
    values = np.exp(-risk) * (1 + 1e-12)
    return np.where(np.isfinite(risk), np.maximum(values, _LEAST), 0.0)


def best_multiplier(task: Relaxation) -> float:
    """Multiplier of arrival with the largest bound of a single agent's risk; any one is valid.

    The bound is a concave function of it, as the least of affine ones.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    costs = StageCosts(Grid.finest(task, _MULTIPLIER_NODES))
    if costs.grid.stride > 1:
        return 0.0

    def loss(multiplier: float) -> float:
        tried = costs.with_multiplier(multiplier)
        return -least_cost(tried, costs_to_go(tried))

    if not np.isfinite(loss(0.0)):
        return 0.0
    largest = -loss(0.0) / task.radius
    while loss(largest) < loss(largest / 2):
        largest *= 2
    largest = min(largest, _LARGEST_ARRIVAL / task.radius)
    return float(minimize_scalar(loss, bounds=(0.0, largest), options={"maxiter": 12}).x)


def _rounding(task: Relaxation, spacing: float) -> float:
    """Bound on the relative rounding error of a node's risk: docs/two-members.md."""
    far = np.abs([task.start, task.center]).max() + task.radius + task.steps * task.step
    operations = 8 * len(task.hazard.after(0).landmarks) + 256
    return float(UNIT * (operations + 64 * far / spacing))


def _rates(task: Relaxation, grid: Grid, region: NodeBlock, certified: bool) -> FloatArray:
    """Rates of a single agent at the nodes of the region and at those around it."""
    h = grid.spacing
    east, north = grid.axes(region.grown(1))
    nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
    if not certified:
        return task.rates(nodes)
    below = task.rates_below(east, north, h)
    if below is None or (below <= 0).any():
        below = task.hazard.single_agent_lower_bound(nodes - h, nodes + h)
    assert below is not None
    return below


def _windows(
    values: FloatArray, combine: np.ufunc = np.maximum, shape: tuple[int, int] = (2, 2)
) -> FloatArray:
    """Values in every window of a shape, combined: by default, at the corners of every cell."""
    return np.asarray(combine.reduce(sliding_window_view(values, shape), axis=(2, 3)))


def _around(cells: FloatArray, combine: np.ufunc = np.maximum) -> FloatArray:
    """Values of the cells around every node, combined."""
    return _windows(np.pad(cells, 1, mode="edge"), combine)


def _variation(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Largest change (2, n, m) between neighbours along each axis in the cells around a node.

    And the largest logarithm (n, m) of the ratio of two corners of one of these cells, 0 where all
    are 0.
    """
    slopes = [
        _windows(np.pad(np.abs(np.diff(values, axis=axis)), 1, mode="edge"), shape=shape)
        for axis, shape in enumerate([(2, 3), (3, 2)])
    ]
    largest, least = _windows(values), _windows(values, np.minimum)
    ratio = np.log(np.divide(largest, least, out=np.ones_like(least), where=largest > 0))
    return np.stack(slopes), _around(ratio) + 1e-12


@dataclass(frozen=True, eq=False)
class PairProgram:
    """The dynamic program of two members on one grid."""

    task: Relaxation  # it starts at the first member
    starts: FloatArray  # (2, 2); those of members that can never arrive are moved: see `gathered`
    tube: Tube
    reach: int  # nodes by which a coordinate changes in a step: the spacing is s / reach
    margin: float  # of the tube, in units of length
    multipliers: tuple[float, float] | None  # of arrival, of one and of both; None: no bounds

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
        arrays = 3 + 4 * self.task.hazard.changes  # of a step
        of_lattice = arrays * (self.task.steps + 1) * n * m + 8 * (2 * n - 1) * (2 * m - 1)
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

        Raises TimeoutError if it is not complete at the `deadline`, a time of `time.monotonic`.
        """
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
                for _, joint, leavers, guarded in self._leavers(step, block, array):
                    np.maximum(joint, guarded, out=joint, where=leavers[..., None, None])
        return self._at_starts(values[0], self.blocks[0][0]), kept[::-1]

    def forward(self, kept: list[Arrays], known: float, deadline: float = math.inf) -> Tube:
        """The tube of the policies of success above `known`; `kept` is from `backward`.

        Raises TimeoutError as `backward`.
        """
        needed = [np.full(block.shape, -known) for block in self.blocks[0]]
        boxes, leaving = [self.tube.boxes[0]], np.zeros_like(self.tube.leaving)
        for step in range(self.task.steps):
            if time.monotonic() > deadline:
                raise TimeoutError
            for array, block in zip(needed, self.blocks[step], strict=True):
                for member, joint, leavers, guarded in self._leavers(step, block, array):
                    leaving[step, member] |= (-joint[leavers] <= guarded).any()
            found, following = [], self.blocks[step + 1]
            last, needed = needed, []
            for block, values, box in zip(
                following, kept[step], self.tube.boxes[step + 1], strict=True
            ):
                array = self._largest(last, self.blocks[step], block)
                discard(array.ravel(), values.ravel())
                for low, high in viable_boxes(array, block, self.spacing):
                    found.append([np.maximum(low, box[0]), np.minimum(high, box[1])])
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

    def _leavers(
        self, step: int, block: NodeBlock, values: FloatArray
    ) -> Iterator[tuple[int, FloatArray, BoolArray, FloatArray]]:
        """Yield each member that may leave the tube's rectangle: its number, values, and nodes.

        The values have the member's axes first; the last array is what the other one, at its nodes,
        can then have at most.
        """
        nodes, orders = members(block), ((0, 1, 2, 3), (2, 3, 0, 1))
        for member in np.flatnonzero(self.tube.leaving[step]).tolist():
            one, other = nodes[member], nodes[1 - member]
            low = np.ceil(self.tube.retreat[step + 1, 0] / self.spacing) + self.reach
            high = np.floor(self.tube.retreat[step + 1, 1] / self.spacing) - self.reach
            x, y = (np.arange(a, b + 1) for a, b in zip(one.first, one.last, strict=True))
            leavers = ((x <= low[0]) | (x >= high[0]))[:, None] | (y <= low[1]) | (y >= high[1])
            guarded = self.lattice.guarded[step][other.within(self.lattice.region)]
            yield member, values.transpose(orders[member]), leavers, guarded

    def _at_starts(self, values: FloatArray, block: NodeBlock) -> float:
        """Geometric interpolation of the values of step 0 at the starts; the first is a node."""
        i, j = -block.first[0], -block.first[1]
        at = (self.starts[1] - self.task.start) / self.spacing - block.first[2:]
        total = 0.0
        for k, m in product((0, 1), (0, 1)):
            weight = abs(1 - k - at[0]) * abs(1 - m - at[1])
            value = float(values[i, j, k, m])
            if value > _LEAST or weight > _NO_WEIGHT:
                total += weight * math.log(value)
        return max(math.exp(total), _LEAST) * _ROUNDED_UP

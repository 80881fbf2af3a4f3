"""Dynamic programming on a grid, backwards from the target and forwards from the start.

A path on the grid visits nodes n_1, ..., n_j, each within reach of the one before, and stops at
any node with a finite `arrival`. It costs the sum of its nodes' costs and the arrival.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from ...typing import FloatArray
from .grid import Block, Grid
from .windows import box_minimum

Node: TypeAlias = tuple[int, int]
Values: TypeAlias = list[list[FloatArray]]
"""For every sample and every block, a value a node."""


@dataclass(frozen=True, eq=False)
class StageCosts:
    """What nodes cost.

    Parameters
    ----------
    grid : Grid
    certified : bool
        Whether costs are such that the least cost bounds the risk of every guide (`Hazard.
        lone_rates_below`), or the rates at the nodes.
    multiplier : float
        Weight of the distance to the target's rim in the cost of arriving; see `arrivals`.
    inside : bool
        Whether paths stop at nodes in the zone alone, as real ones do.
    """

    grid: Grid
    certified: bool = True
    multiplier: float = 0.0
    inside: bool = False
    nodes: Values = field(init=False, repr=False)
    """Risk of a visit; infinite where no active cell is."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", self._costs())

    def _costs(self) -> Values:
        grid, size = self.grid, self.grid.size
        every = [block for blocks in grid.blocks for block in blocks]
        if not every:
            return [[] for _ in grid.blocks]
        low = np.min([block.low for block in every], axis=0)
        shape = np.max([block.high for block in every], axis=0) - low + 1
        shared = self._rates(tuple(low), tuple(shape)) if shape.prod() <= size else None
        found: Values = []
        for blocks in grid.blocks:
            found.append([])
            for block in blocks:
                if shared is None:
                    costs = self._rates(block.low, block.shape)
                else:
                    i, j = np.subtract(block.low, low)
                    costs = shared[i : i + block.shape[0], j : j + block.shape[1]]
                if not block.cells.all():
                    costs = np.where(block.nodes, costs, np.inf)
                found[-1].append(costs)
        return found

    def _rates(self, low: tuple[int, int], shape: tuple[int, int]) -> FloatArray:
        grid, hazard = self.grid, self.grid.task.hazard
        east, north = grid.axes(low, shape)
        if self.certified:
            rates = hazard.lone_rates_below(east, north, grid.spacing)
            assert rates is not None
        else:
            rates = hazard.single_agent_rates(
                np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
            )
        rates *= grid.merged * grid.task.dt
        return rates

    def arrivals(self, block: Block) -> FloatArray:
        """Cost of stopping at a block's nodes, infinite where no adjacent cell touches the zone.

        With g(x) = (||x - c||^2 - R^2) / (2 R), about the distance from the rim, it is `multiplier`
        times g - h^2 / (4 R) near the rim and 0 deep inside: interpolated, not above 0 in the zone.
        """
        grid, task = self.grid, self.grid.task
        h, radius = grid.spacing, task.radius
        slack = (grid.merged - 1) * task.step
        away = [
            np.abs(nodes - place)
            for nodes, place in zip(grid.axes(block.low, block.shape), task.center, strict=True)
        ]
        margin = 0.0 if self.inside else h + slack  # of the cells around a node
        near = [np.maximum(a - margin, 0.0) ** 2 for a in away]
        touched = near[0][:, None] + near[1] <= radius**2 * (1 + 1e-12)
        if self.multiplier == 0.0 or grid.merged > 1:
            return np.where(touched, 0.0, np.inf)
        squared = (away[0] ** 2)[:, None] + away[1] ** 2
        deep = squared < max(radius - 1.5 * h, 0.0) ** 2
        cost = self.multiplier * ((squared - radius**2) / (2 * radius) - h**2 / (4 * radius))
        return np.where(touched, np.where(deep, 0.0, cost), np.inf)

    @property
    def largest_arrival(self) -> float:
        """Bound on the absolute cost of arriving."""
        h, radius = self.grid.spacing, self.grid.task.radius
        return self.multiplier * (3 * h + 3 * h**2 / radius)


def point(node: Node) -> Block:
    """A block of a node alone."""
    return Block(node, np.ones((0, 0), bool))


def spread(
    sources: list[FloatArray], blocks: tuple[Block, ...], to: Block, reach: int
) -> FloatArray:
    """At the nodes of a block, the least value within reach at the nodes of `blocks`."""
    out = np.full(to.shape, np.inf)
    for values, block in zip(sources, blocks, strict=True):
        first = (to.low[0] - block.low[0], to.low[1] - block.low[1])
        np.minimum(out, box_minimum(values, first, to.shape, reach), out=out)
    return out


def backward(prices: StageCosts) -> Values:
    """Least cost of a visit to every node at every sample and of all that follows."""
    grid = prices.grid
    values: Values = [[] for _ in grid.blocks]
    after: list[FloatArray] = []
    following: tuple[Block, ...] = ()
    for sample in reversed(range(len(grid.blocks))):
        for block, costs in zip(grid.blocks[sample], prices.nodes[sample], strict=True):
            to_go = spread(after, following, block, grid.reach)
            np.minimum(to_go, prices.arrivals(block), out=to_go)
            values[sample].append(to_go + costs)
        after, following = values[sample], grid.blocks[sample]
    return values


def forward(prices: StageCosts) -> Iterator[list[FloatArray]]:
    """For every sample, the least cost of getting to every node, its own cost left out."""
    grid = prices.grid
    before: list[FloatArray] = [np.zeros((1, 1))]
    previous: tuple[Block, ...] = (point((0, 0)),)
    for blocks, costs in zip(grid.blocks, prices.nodes, strict=True):
        arriving = [spread(before, previous, block, grid.reach) for block in blocks]
        yield arriving
        before = [value + cost for value, cost in zip(arriving, costs, strict=True)]
        previous = blocks


def least(prices: StageCosts, values: Values) -> float:
    """Least cost of a path from the start, by what `backward` gave."""
    start = point((0, 0))
    grid = prices.grid
    found = float(spread(values[0], grid.blocks[0], start, grid.reach)[0, 0])
    if grid.merged > 1:  # a path that arrives before its first sample
        found = min(found, float(prices.arrivals(start)[0, 0]))
    return found


def best_node(
    values: list[FloatArray], blocks: tuple[Block, ...], at: Node, reach: int
) -> tuple[float, Node]:
    """Least value within reach of a node, and where; infinite if there is none."""
    best, place = np.inf, at
    for block, value in zip(blocks, values, strict=True):
        i, j = (max(0, at[axis] - reach - block.low[axis]) for axis in (0, 1))
        ends = [max(0, at[axis] + reach - block.low[axis] + 1) for axis in (0, 1)]
        window = value[i : ends[0], j : ends[1]]
        if window.size and window.min() < best:
            best = float(window.min())
            row, column = np.unravel_index(int(window.argmin()), window.shape)
            place = (block.low[0] + i + int(row), block.low[1] + j + int(column))
    return best, place


def trace(prices: StageCosts, values: Values, at: Node = (0, 0), sample: int = 0) -> list[Node]:
    """Nodes of a least-cost path onwards from a node at a sample (0 is the start)."""
    grid = prices.grid
    path = [at]
    for following in range(sample, len(grid.blocks)):
        onwards, place = best_node(values[following], grid.blocks[following], at, grid.reach)
        stopping = prices.arrivals(point(at))[0, 0] if following else np.inf
        if min(onwards, stopping) == np.inf or stopping <= onwards:
            break
        at = place
        path.append(at)
    return path


def trace_back(prices: StageCosts, arriving: Values, at: Node, sample: int) -> list[Node]:
    """Nodes of a least-cost path from the start to a node at a sample; `forward` gave `arriving`.

    The node itself is not among them.
    """
    grid = prices.grid
    path: list[Node] = []
    for before in reversed(range(sample - 1)):
        costs = [a + b for a, b in zip(arriving[before], prices.nodes[before], strict=True)]
        at = best_node(costs, grid.blocks[before], at, grid.reach)[1]
        path.append(at)
    return [(0, 0), *reversed(path)]

"""Dynamic programming on a grid, backwards from the target and forwards from the start.

A path on the grid visits nodes n_1, ..., n_j, each within reach of the previous one, and stops at
any node with a finite terminal cost. Its cost is the sum of its nodes' costs and the terminal cost.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ..hazard import Hazard
from ..hazard.rate_bounds import cap_radius
from ..typing import FloatArray
from .nodes import UNIT, CellBlock, Grid, NodeBlock, Relaxation, Window, extremum_in_windows

Node: TypeAlias = tuple[int, int]
Values: TypeAlias = list[list[FloatArray]]
"""Node values, an array for every block of every sample."""

START = NodeBlock((0, 0), (1, 1))
_ROUNDING = 64 * UNIT  # of a coordinate in a step of a path, relative


@dataclass(frozen=True, eq=False)
class StageCosts:
    """Costs of visiting a node and of stopping there.

    Parameters
    ----------
    grid : Grid
    certified : bool
        Whether costs are such that the least cost bounds the risk of every guide
        (`Hazard.single_agent_rates_below`), or follow from the rates at the nodes.
    multiplier : float
        Weight of the distance to the target's rim in the terminal cost; see `terminal`.
    inside : bool
        Whether paths may stop only at nodes in the target zone, as real paths do.
    """

    grid: Grid
    certified: bool = True
    multiplier: float = 0.0
    inside: bool = False

    @cached_property
    def nodes(self) -> Values:
        """Risk of a visit; infinite at nodes of no active cell."""
        phases: dict[tuple[Relaxation, ...], list[int]] = {}
        for sample in range(len(self.grid.blocks)):
            phases.setdefault(self.relaxations(sample), []).append(sample)
        values: Values = [[] for _ in self.grid.blocks]
        for relaxations, samples in phases.items():
            self._write_phase(relaxations, samples, values)
        return values

    def relaxations(self, sample: int) -> tuple[Relaxation, ...]:
        """The task with the rates of the steps that a sample, from 0, may be taken at.

        For a bound those are all m of them: the m paths of a guide have different ones.
        """
        grid, task = self.grid, self.grid.task
        if not task.hazard.changes:
            return (task,)
        last = min((sample + 1) * grid.stride, task.steps)
        steps = range(sample * grid.stride + 1, last + 1) if self.certified else [last]
        hazards = dict.fromkeys(task.hazard.after(step) for step in steps)
        return tuple(self._tasks.setdefault(each, replace(task, hazard=each)) for each in hazards)

    @cached_property
    def _tasks(self) -> dict[Hazard, Relaxation]:
        """The task with the rates of other times, one object for equal rates."""
        return {}

    def _write_phase(
        self, relaxations: tuple[Relaxation, ...], samples: list[int], values: Values
    ) -> None:
        """Write the risks of samples that have the rates of the same relaxations."""
        grid = self.grid
        blocks = [block for sample in samples for block in grid.blocks[sample]]
        if not blocks:
            return
        hull = NodeBlock.hull(block.nodes for block in blocks)
        # one evaluation serves all samples where their blocks overlap enough
        size = sum(block.nodes.size for block in blocks)
        shared = self.visits(hull, relaxations) if hull.size <= size else None

        def costs(block: CellBlock) -> FloatArray:
            nodes = block.nodes
            whole = self.visits(nodes, relaxations) if shared is None else shared
            rates = whole if shared is None else whole[nodes.within(hull)]
            return rates if block.cells.all() else np.where(block.visited, rates, np.inf)

        for sample in samples:
            values[sample] = [costs(block) for block in grid.blocks[sample]]

    def with_multiplier(self, multiplier: float) -> StageCosts:
        """Copy with another multiplier, on which risks of visits do not depend."""
        other = replace(self, multiplier=multiplier)
        other.__dict__["nodes"] = self.nodes
        return other

    def visits(self, nodes: NodeBlock, relaxations: tuple[Relaxation, ...]) -> FloatArray:
        """Least risk of a visit to each node, of those with the rates of each relaxation."""
        grid = self.grid
        east, north = grid.axes(nodes)
        least: FloatArray | None = None
        for task in relaxations:
            if self.certified:
                rates = task.rates_below(east, north, grid.spacing)
                assert rates is not None
            else:
                rates = task.rates(np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1))
            least = rates if least is None else np.minimum(least, rates)
        assert least is not None
        least *= grid.stride * grid.task.dt
        return least

    def terminal(self, nodes: NodeBlock) -> FloatArray:
        """Cost of stopping at the nodes of a block, infinite if no adjacent cell touches the zone.

        phi of ``docs/global-guide.md``, equation (G6): with g(x) = (||x - c||^2 - R^2) / (2 R),
        about the distance from the rim, it is `multiplier` times g - h^2 / (4 R) near the rim and 0
        deep inside: interpolated, not above 0 in the zone.
        """
        grid, task = self.grid, self.grid.task
        h, radius = grid.spacing, task.radius
        slack = (grid.stride - 1) * task.step
        offsets = [np.abs(x - c) for x, c in zip(grid.axes(nodes), task.center, strict=True)]
        margin = 0.0 if self.inside else h + slack  # of the cells around a node
        near = [np.maximum(offset - margin, 0.0) ** 2 for offset in offsets]
        largest = radius + float(np.abs([task.start, task.center]).max())
        rounding = _ROUNDING * task.steps * largest  # of a path's coordinates
        rim = max(radius - rounding, 0.0) if self.inside else radius + rounding
        touched = near[0][:, None] + near[1] <= rim**2
        if self.multiplier == 0.0 or grid.stride > 1:
            return np.where(touched, 0.0, np.inf)
        squared = (offsets[0] ** 2)[:, None] + offsets[1] ** 2
        deep = squared < max(radius - 1.5 * h, 0.0) ** 2
        cost = self.multiplier * ((squared - radius**2) / (2 * radius) - h**2 / (4 * radius))
        return np.where(touched, np.where(deep, 0.0, cost), np.inf)

    @property
    def max_terminal(self) -> float:
        """Bound on the absolute terminal cost."""
        h, radius = self.grid.spacing, self.grid.task.radius
        return self.multiplier * (3 * h + 3 * h**2 / radius)


def rounding(stage_costs: StageCosts, risk: float, interpolated: bool = False) -> float:
    """Bound on the rounding error of a path's cost: docs/global-guide.md.

    Parameters
    ----------
    stage_costs : StageCosts
    risk : float
        Bound on the path's risk; on that of paths from the four nodes around, if `interpolated`.
    interpolated : bool
        Whether costs are interpolated at the start of the path.

    Returns
    -------
    float
        In the unit of the costs, a risk.
    """
    grid, task = stage_costs.grid, stage_costs.grid.task
    operations = 4 * len(grid.blocks) + 8 * len(task.hazard.after(0).landmarks) + 256
    wide = task.radius + task.steps * task.step
    far = np.maximum(np.abs(task.start), np.abs(task.center)).max() + wide
    core_radius = getattr(task.hazard.after(1), "core_radius", 0.0)
    coordinates = 32 * far / cap_radius(grid.spacing, core_radius)
    if interpolated:
        coordinates += 32 * (np.abs(task.start - task.center).max() + wide) / grid.spacing
    return float(UNIT * (operations + coordinates) * (risk + 2 * stage_costs.max_terminal))


def backwards(
    stage_costs: StageCosts, scale: float = 1.0
) -> Iterator[tuple[list[FloatArray], list[FloatArray]]]:
    """Costs after a visit and with it, of the nodes of every sample, from the last one.

    W_t of ``docs/global-guide.md``, equation (G2), with lambda in `StageCosts.nodes`, times
    `scale`, and phi in `StageCosts.terminal`: W_t(n) = lambda(n) + min(phi(n), min over n' within
    reach of W_(t+1)(n')).
    """
    grid, values = stage_costs.grid, list[FloatArray]()
    blocks: tuple[NodeBlock, ...] = ()
    for nodes, costs in zip(reversed(grid.nodes), reversed(stage_costs.nodes), strict=True):
        after = [extremum_in_windows(values, blocks, each, grid.windows) for each in nodes]
        for to_go, each in zip(after, nodes, strict=True):
            np.minimum(to_go, stage_costs.terminal(each), out=to_go)
        scaled = costs if scale == 1.0 else [cost * scale for cost in costs]
        values = [to_go + cost for to_go, cost in zip(after, scaled, strict=True)]
        blocks = nodes
        yield after, values


def costs_to_go(stage_costs: StageCosts, deadline: float = math.inf) -> Values:
    """Least cost of a visit to every node at every sample and of all that follows: `backwards`.

    Raises
    ------
    TimeoutError
        It is not complete at the `deadline`, a time of `time.monotonic`.
    """
    found: Values = []
    steps = backwards(stage_costs)
    for _ in stage_costs.grid.blocks:
        if time.monotonic() > deadline:
            raise TimeoutError
        found.append(next(steps)[1])
    return found[::-1]


def costs_to_come(stage_costs: StageCosts) -> Iterator[list[FloatArray]]:
    """Least cost of reaching every node, without its own cost, one sample at a time.

    F_t of equation (G3): F_(t+1)(n) = min over n' within reach of (F_t(n') + lambda(n')).
    """
    grid = stage_costs.grid
    values: list[FloatArray] = [np.zeros((1, 1))]
    last: tuple[NodeBlock, ...] = (START,)
    for blocks, costs in zip(grid.nodes, stage_costs.nodes, strict=True):
        to_come = [extremum_in_windows(values, last, nodes, grid.windows) for nodes in blocks]
        yield to_come
        values = [value + cost for value, cost in zip(to_come, costs, strict=True)]
        last = blocks


def least_cost(stage_costs: StageCosts, to_go: Values) -> float:
    """Least cost of a path from the start, from the result of `costs_to_go`."""
    grid = stage_costs.grid
    least = extremum_in_windows(to_go[0], grid.nodes[0], START, grid.windows)
    if grid.stride > 1:  # a path may arrive before its first sample
        least = np.minimum(least, stage_costs.terminal(START))
    return float(least[0, 0])


def best_node(
    values: list[FloatArray], blocks: tuple[NodeBlock, ...], at: Node, windows: Sequence[Window]
) -> tuple[float, Node]:
    """Least value in any window around a node, and its node; infinite if there is none."""
    best, best_at = np.inf, at
    for (block, value), reach in itertools.product(zip(blocks, values, strict=True), windows):
        near = NodeBlock(at, (1, 1)).grown(reach).common(block)
        window = value[near.within(block)]
        if window.size and window.min() < best:
            best = float(window.min())
            row, column = np.unravel_index(int(window.argmin()), window.shape)
            best_at = near.first[0] + int(row), near.first[1] + int(column)
    return best, best_at


def trace(stage_costs: StageCosts, to_go: Values, at: Node = (0, 0), sample: int = 0) -> list[Node]:
    """Nodes of a least-cost path from a node at a sample (0 is the start) to the target."""
    grid, path = stage_costs.grid, [at]
    for following in range(sample, len(grid.blocks)):
        cost, node = best_node(to_go[following], grid.nodes[following], path[-1], grid.windows)
        stopping = stage_costs.terminal(NodeBlock(path[-1], (1, 1))) if following else np.inf
        if cost == np.inf or stopping <= cost:
            break
        path.append(node)
    return path


def trace_back(stage_costs: StageCosts, to_come: Values, at: Node, sample: int) -> list[Node]:
    """Nodes of a least-cost path from the start to a node at a sample, without the node itself."""
    grid, path = stage_costs.grid, [at]
    for previous in reversed(range(sample - 1)):
        costs = [a + b for a, b in zip(to_come[previous], stage_costs.nodes[previous], strict=True)]
        path.append(best_node(costs, grid.nodes[previous], path[-1], grid.windows)[1])
    return [(0, 0), *reversed(path[1:])]

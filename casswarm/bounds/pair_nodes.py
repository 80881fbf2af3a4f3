"""Node values of the dynamic program of two members: risks, protection, and lone survivors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from ..grid.dynamic_programming import StageCosts, costs_to_go, least_cost
from ..grid.node_blocks import NodeBlock, extremum_within_reach
from ..grid.nodes import UNIT, Grid, Relaxation
from ..typing import FloatArray

if TYPE_CHECKING:
    from .pair_kernels import MemberNodes, PairNodes

_MULTIPLIER_NODES = 50_000
_LARGEST_ARRIVAL = 300.0
"""Largest product of multiplier and radius: exponentials of costs of arrival do not overflow."""


@dataclass(frozen=True, eq=False)
class PairLattice:
    """Functions on the nodes x_1(0) + h (i, j), for both members, and on their differences.

    Parameters
    ----------
    grid : Grid
        Of a single agent, from either start.
    region : NodeBlock
        All nodes that either member visits.
    risk, slopes, spread : (n, m), (2, n, m), (n, m)
        As of `MemberNodes`.
    alone, floor, guarded : (N+1, n, m)
        Upper bounds, for steps 0 to N, of the probability that a single agent arrives, with the
        multipliers of arrival of an agent and of a pair, and that an agent does that is always
        protected by an immortal one out of reach of the target.
    pair : PairNodes
    """

    grid: Grid
    region: NodeBlock
    risk: FloatArray
    slopes: FloatArray
    spread: FloatArray
    alone: FloatArray
    floor: FloatArray
    guarded: FloatArray
    pair: PairNodes

    def member(self, step: int, nodes: NodeBlock) -> MemberNodes:
        """Functions on the nodes of one member after step `step`, from 1."""
        from .pair_kernels import MemberNodes

        at = nodes.within(self.region)
        risk = self.risk[at], self.slopes[:, *at], self.spread[at]
        arrays = *risk, self.alone[step][at], self.floor[step][at]
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
    single, both = (
        StageCosts(grid, certified, multiplier, inside=not certified)
        for multiplier in multipliers or (0.0, 0.0)
    )
    both.__dict__["nodes"] = single.nodes  # the cached property: it does not depend on it
    risk, exact = task.dt * _rates(grid, region, certified), 1.0
    if certified:
        exact -= _rounding(task, grid.spacing)
        risk *= exact
    n, m = region.shape
    bounds = task.hazard.pair_bounds((n, m), grid.spacing, certified)
    assert bounds is not None
    pair = _pair_nodes(bounds.share, exact * task.dt * bounds.collision)
    slopes, spread = _slopes(risk), _spread(risk)
    if not certified:
        pair = pair._replace(
            slopes=0 * pair.slopes,
            spread=0 * pair.spread,
            collision_range=0 * pair.collision_range,
        )
        slopes, spread = 0 * slopes, 0 * spread
    row, column = np.array(pair.share.shape) // 2
    guarded = max(  # it increases outwards
        float(pair.share[min(row + margin, 2 * row), column]),
        float(pair.share[row, min(column + margin, 2 * column)]),
    )
    inner = (slice(1, -1), slice(1, -1))
    alone, floor, with_guard = (
        lone_values(costs, region, share, exact)
        for costs, share in ((single, 1.0), (both, 1.0), (both, guarded))
    )
    return PairLattice(
        grid, region, risk[inner], slopes[:, *inner], spread[inner], alone, floor, with_guard, pair
    )


def _pair_nodes(share: FloatArray, collision: FloatArray) -> PairNodes:
    from .pair_kernels import PairNodes

    least, largest = (_cells(collision, combine) for combine in (np.minimum, np.maximum))
    return PairNodes(
        share,
        _slopes(share),
        _spread(share),
        collision,
        _around(least, np.minimum),
        _around(largest - least, np.maximum),
    )


def lone_values(costs: StageCosts, region: NodeBlock, share: float, exact: float) -> FloatArray:
    """Upper bounds (N, n, m) of the probability that an agent arrives, from every node.

    Its risk is `share` times that of a single agent. The cost of arrival is not scaled.
    """
    grid = costs.grid
    out = np.zeros((len(grid.blocks) + 1, *region.shape))
    following: list[FloatArray] = []
    blocks: tuple[NodeBlock, ...] = ()
    for sample in reversed(range(len(grid.blocks))):
        values = []
        for nodes, cost in zip(grid.nodes[sample], costs.nodes[sample], strict=True):
            to_go = extremum_within_reach(following, blocks, nodes, grid.reach)
            np.minimum(to_go, costs.terminal(nodes), out=to_go)
            common = nodes.common(region)
            out[sample + 1][common.within(region)] = _survival(to_go[common.within(nodes)])
            values.append(to_go + cost * (share * exact))
        following, blocks = values, grid.nodes[sample]
    out[0] = _survival(extremum_within_reach(following, blocks, region, grid.reach))
    return out


def _survival(risk: FloatArray) -> FloatArray:
    """exp(-risk), rounded up by more than the rounding of sums of risks and terminal costs.

    It is positive, if only just, wherever the target is within reach.
    """
    values = np.exp(-risk) * (1 + 1e-12)
    return np.where(np.isfinite(risk), np.maximum(values, np.finfo(float).tiny), 0.0)


def best_multiplier(task: Relaxation) -> float:
    """Multiplier of arrival with the largest bound of a single agent's risk; any one is valid.

    The bound is a concave function of it, as the least of affine ones.
    """
    grid = Grid.finest(task, _MULTIPLIER_NODES)
    if grid.stride > 1:
        return 0.0
    nodes = StageCosts(grid).nodes

    def loss(multiplier: float) -> float:
        costs = StageCosts(grid, multiplier=multiplier)
        costs.__dict__["nodes"] = nodes  # the cached property: it does not depend on it
        return -least_cost(costs, costs_to_go(costs))

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
    operations = 8 * len(task.hazard.radar_positions) + 256
    return float(UNIT * (operations + 64 * far / spacing))


def _rates(grid: Grid, region: NodeBlock, certified: bool) -> FloatArray:
    """Rates of a single agent at the nodes of the region and at those around it."""
    task, h = grid.task, grid.spacing
    east, north = grid.axes(region.grown(1))
    nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
    if not certified:
        return task.rates(nodes)
    below = task.rates_below(east, north, h)
    if below is None or (below <= 0).any():
        below = task.hazard.single_agent_lower_bound(nodes - h, nodes + h)
    assert below is not None
    return below


def _slopes(values: FloatArray) -> FloatArray:
    """Largest change (2, n, m) between neighbours along each axis in the cells around a node."""
    slopes = []
    for axis in (0, 1):
        change = np.abs(np.diff(values, axis=axis))
        across = np.moveaxis(change, axis, 0)
        wide = np.pad(across, ((1, 1), (1, 1)), mode="edge")
        wide = np.maximum(wide[:-1], wide[1:])
        wide = np.maximum(np.maximum(wide[:, :-2], wide[:, 1:-1]), wide[:, 2:])
        slopes.append(np.moveaxis(wide, 0, axis))
    return np.stack(slopes)


def _cells(values: FloatArray, combine: np.ufunc) -> FloatArray:
    """Values of the corners of every cell, combined."""
    rows = combine(values[:-1], values[1:])
    return np.asarray(combine(rows[:, :-1], rows[:, 1:]))


def _around(cells: FloatArray, combine: np.ufunc) -> FloatArray:
    """Values of the cells around every node, combined."""
    padded = np.pad(cells, 1, mode="edge")
    rows = combine(padded[:-1], padded[1:])
    return np.asarray(combine(rows[:, :-1], rows[:, 1:]))


def _spread(values: FloatArray) -> FloatArray:
    """Largest logarithm of the ratio of two corners of a cell around every node."""
    ratio = np.log(_cells(values, np.maximum) / _cells(values, np.minimum))
    return _around(ratio, np.maximum) + 1e-12

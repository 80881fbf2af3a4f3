"""Proven lower bounds on the risk of every guide, on grids refined where a better one may exist."""

from __future__ import annotations

import math
import time
from collections.abc import Generator, Iterator
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from ..grid.dynamic_programming import (
    START,
    StageCosts,
    Values,
    costs_to_come,
    costs_to_go,
    least_cost,
    rounding,
)
from ..grid.nodes import Grid, NodeBlock, Relaxation, corners, extremum_within_reach
from ..typing import FloatArray
from .acceleration_bound import AccelerationBound
from .disc_bound import disc_levels
from .refinement import Clock, Level, refined

GAP = 0.01  # default relative gap at which a certificate is good enough
FIRST_NODES = 400_000  # maximum of the first grid, if the stride can be chosen so
MAX_NODES = 10_000_000  # maximum of any grid: three numbers each take 240 MB
_SHARE = 0.1  # of the time, for paths that are rounded to nodes, where `disc_levels` follow


@dataclass(frozen=True)
class Certificate:
    """A proven lower bound on the risk of every guide of a scenario.

    Parameters
    ----------
    bound : float
        No path that obeys the speed limit and is in the target by step N has less risk.
    best : float
        Risk of the best known such path: the least risk lies between the two.
    reason : str
        Why the refinement ended.
    levels : tuple of Level
    seconds : float
    accelerated : AccelerationBound, optional
        A larger bound, on the risk of the paths that obey the limits of acceleration, too.
    """

    bound: float
    best: float
    reason: str
    levels: tuple[Level, ...] = field(default=(), repr=False)
    seconds: float = 0.0
    accelerated: AccelerationBound | None = None

    @property
    def risk_bound(self) -> float:
        """The bound with limits of acceleration if there is one, else `bound`."""
        return self.bound if self.accelerated is None else self.accelerated.bound

    @property
    def gap(self) -> float:
        """(best - bound) / best, without limits of acceleration and margin."""
        return (self.best - self.bound) / self.best if self.best > 0 else 0.0

    @property
    def survival(self) -> float:
        """exp(-best)."""
        return math.exp(-self.best)

    def as_dict(self) -> dict[str, object]:
        """Plain values, for a record."""
        return asdict(self) | {"gap": self.gap}


def certify(
    task: Relaxation,
    best: float,
    multiplier: float = 0.0,
    *,
    gap: float = GAP,
    time_limit: float = 60.0,
    first_nodes: int = FIRST_NODES,
    max_nodes: int = MAX_NODES,
) -> Certificate:
    """Bound on the risk of all guides, refined until it is within `gap` of the best known risk.

    Parameters
    ----------
    task : Relaxation
        Its hazard must provide `single_agent_rates_below`, at every step if rates depend on time.
    best : float
        Risk of a known path of the relaxation.
    multiplier : float
        Minus the derivative of that risk with respect to the target's radius. Any value is valid;
        with a good one the bound converges to `best` as the square of the spacing.
    gap : float
        Value of (best - bound) / best at which to stop.
    time_limit : float
        Seconds; no grid is begun that is expected to exceed them.
    first_nodes, max_nodes : int
        Maximum number of nodes of the first grid, if the stride can be chosen so, and of any grid.

    Returns
    -------
    Certificate
        With a level for every grid, and no bound with limits of acceleration.
    """
    clock = Clock(time.monotonic() + time_limit)
    late = f"the next grid would exceed the time limit of {time_limit:.3g} s"
    grid = Grid.finest(task, first_nodes)
    first = replace(clock, deadline=clock.started + _SHARE * time_limit) if task.disc else clock
    levels, reason = refined(_levels(grid, best, multiplier, gap, max_nodes, first), late)
    if task.disc and levels[-1].bound < (1 - gap) * best:
        goals = levels[-1].bound, best, multiplier, gap, max_nodes, clock
        finer, reason = refined(disc_levels(task, *goals), late)
        levels += finer
    return Certificate(levels[-1].bound, best, reason, levels, clock.seconds)


def _levels(
    grid: Grid, best: float, multiplier: float, gap: float, max_nodes: int, clock: Clock
) -> Generator[Level, None, str]:
    """Grids of a refinement, each with the bound so far; why there is no other one."""
    bound = 0.0
    while True:
        stage_costs = StageCosts(grid, multiplier=multiplier)
        to_go = costs_to_go(stage_costs)
        slack = rounding(stage_costs, best)
        bound = max(bound, min(best, least_cost(stage_costs, to_go)) - slack)
        yield Level(grid.stride, grid.reach, grid.spacing, grid.size, bound, clock.seconds)
        if bound >= (1 - gap) * best:
            return f"the gap of {gap:g} is reached"
        if slack > 0.1 * gap * best and bound > best - 2 * slack:
            return "the remaining gap is within rounding errors"
        refined_grid = _refined(stage_costs, to_go, best + slack, max_nodes)
        if refined_grid is None:
            return f"the next grid has more than {max_nodes:,} nodes"
        clock.begin(refined_grid.size / max(grid.size, 1))
        grid = refined_grid


def _refined(
    stage_costs: StageCosts, to_go: Values, threshold: float, max_nodes: int
) -> Grid | None:
    """The next grid, without cells that no better guide visits; None if it is too large."""
    grid = stage_costs.grid
    totals = _strided_totals if grid.stride > 1 else _totals
    active = tuple(
        tuple(
            block.cells & np.any([corner <= threshold for corner in corners(risk)], axis=0)
            for block, risk in zip(blocks, risks, strict=True)
        )
        for blocks, risks in zip(grid.blocks, totals(stage_costs, to_go), strict=True)
    )
    cells = sum(np.count_nonzero(mask) for masks in active for mask in masks)
    if 4 * cells * (1 + (grid.stride > 1)) > max_nodes:
        return None
    refined = grid.halved(active)
    return refined if refined.size <= max_nodes else None


def _totals(stage_costs: StageCosts, to_go: Values) -> Iterator[list[FloatArray]]:
    """Yield for every step the least cost of the paths through every node."""
    for come, go in zip(costs_to_come(stage_costs), to_go, strict=True):
        yield [a + b for a, b in zip(come, go, strict=True)]


def _strided_totals(stage_costs: StageCosts, to_go: Values) -> Iterator[list[FloatArray]]:
    """Yield for the steps of every sample a bound on the risk of the guides near every node.

    All samples of a guide's m paths taken within those steps are within k nodes of its position at
    any of them; a path that has already ended took its last sample within 2 k.
    """
    grid = stage_costs.grid
    last: tuple[NodeBlock, ...] = (START,)
    ended = [stage_costs.terminal(START)]
    for sample, come in enumerate(costs_to_come(stage_costs)):
        blocks = grid.nodes[sample]
        through = [a + b for a, b in zip(come, to_go[sample], strict=True)]
        yield [
            np.minimum(
                extremum_within_reach(through, blocks, nodes, grid.reach),
                extremum_within_reach(ended, last, nodes, 2 * grid.reach),
            )
            for nodes in blocks
        ]
        ended = [
            before + cost + stage_costs.terminal(nodes)
            for before, cost, nodes in zip(come, stage_costs.nodes[sample], blocks, strict=True)
        ]
        last = blocks


def arrival_multiplier(task: Relaxation, positions: FloatArray) -> float:
    """Decrease of the risk of a locally best path per increase of the target's radius.

    From its optimality conditions: with a_t the derivative of the risk with respect to a common
    shift of X(t+1), ..., X(T), and n the outward direction at the rim, a_t + multiplier n vanishes
    in every component of V(t) that is not at its limit, and points outwards in the others. The
    positions (T+1, 2) are those of a path without acceleration limits. Any value, at least 0, is
    valid for `certify`.
    """
    outward = positions[-1] - task.center
    distance = float(np.hypot(*outward))
    if distance < 0.999 * task.radius:  # the arrival constraint is inactive
        return 0.0
    normal = np.broadcast_to(outward / distance, positions[1:].shape)
    shift = 1e-6 * task.step * np.eye(2)
    rates = [task.rates_along(positions[1:, None] + sign * shift) for sign in (1, -1)]
    slopes = task.dt * (rates[0] - rates[1]) / (2e-6 * task.step)
    gradients = np.cumsum(slopes[::-1], axis=0)[::-1]
    moves = np.diff(positions, axis=0)
    if task.disc:
        return _multiplier_of_disc(task, moves, gradients, normal)
    free = np.abs(moves) < task.step * (1 - 1e-4)
    weight = float((normal[free] ** 2).sum())
    if weight > 1e-6:
        return max(0.0, float(-(gradients * normal)[free].sum()) / weight)
    toward = ~free & (np.sign(moves) * normal < -1e-6)
    needed = gradients[toward] / -normal[toward]
    return max(0.0, float(needed.max(initial=0.0)))


def _multiplier_of_disc(
    task: Relaxation, moves: FloatArray, gradients: FloatArray, normal: FloatArray
) -> float:
    """`arrival_multiplier` where the length of a step is limited.

    At that limit a_t + multiplier n vanishes across the direction of the step only.
    """
    length = np.hypot(*moves.T)[:, None]
    along = moves / np.maximum(length, 1e-300)
    limited = length >= task.step * (1 - 1e-4)
    across = [v - np.where(limited, (v * along).sum(axis=1)[:, None] * along, 0.0)
              for v in (gradients, normal)]  # fmt: skip
    weight = float((across[1] ** 2).sum())
    return max(0.0, -float((across[0] * across[1]).sum()) / weight) if weight > 1e-6 else 0.0

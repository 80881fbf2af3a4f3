"""Proven lower bounds on the risk of every guide, on grids refined where a better one may exist."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ...optimization.solvers import make_solver
from ...problems.guide import GuideTask
from ...typing import FloatArray
from ..guide import Candidate, Guide
from ..homotopy import best_homotopy_classes
from ..kinematics import integrate
from ..multistart import Multistart
from .dynamic_programming import (
    StageCosts,
    Values,
    costs_to_come,
    costs_to_go,
    least_cost,
    minimum_within_reach,
    rounding,
    single_node,
)
from .grid import Block, Grid, Relaxation, corners

if TYPE_CHECKING:
    from ...scenario import Scenario

GAP, TIME_LIMIT = 0.01, 10.0
"""Default relative gap at which a certificate is good enough, and default time limit in seconds."""

FIRST_NODES = 400_000
"""Maximum number of nodes of the first grid, if the stride can be chosen so."""

MAX_NODES = 10_000_000
"""Maximum number of nodes of any grid: three numbers each take 240 MB."""


@dataclass(frozen=True)
class Level:
    """One grid of a refinement.

    Parameters
    ----------
    stride, reach : int
        Time steps and nodes per sample.
    spacing : float
        Side of a cell.
    nodes : int
        Over all samples.
    bound : float
        Lower bound on the risk of any guide, from the grids so far.
    seconds : float
        Since the start of the refinement.
    """

    stride: int
    reach: int
    spacing: float
    nodes: int
    bound: float
    seconds: float


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
    """

    bound: float
    best: float
    reason: str
    levels: tuple[Level, ...] = field(default=(), repr=False)
    seconds: float = 0.0

    @property
    def gap(self) -> float:
        """(best - bound) / best: the gap that is left without limits of acceleration and margin."""
        return (self.best - self.bound) / self.best if self.best > 0 else 0.0

    @property
    def survival(self) -> float:
        """exp(-best)."""
        return math.exp(-self.best)

    def as_dict(self) -> dict[str, object]:
        """Plain values, for a record."""
        return asdict(self) | {"gap": self.gap}


def certify_guide(
    scenario: Scenario, guide: Guide, gap: float = GAP, deadline: float | None = None
) -> Certificate | None:
    """Certificate for the guides of a scenario; None if its hazard provides no lower bounds.

    The bound is compared with the best known path without acceleration limits and margin: the
    guide itself, or what Ipopt reaches from the best homotopy classes. The `deadline` is a time of
    `time.monotonic`; by default the refinement of grids takes at most `TIME_LIMIT`.
    """
    task = Relaxation.from_scenario(scenario)
    if not task.bounded:
        return None
    paths = [guide.positions]
    limited = np.isfinite(scenario.guide_a_max) or scenario.swarm.velocity != "guide"
    smaller_target = scenario.arrival_margin > 1e-5 * task.radius
    if limited or smaller_target or guide.search != "global":
        paths += _relaxed_paths(scenario, task, math.inf if deadline is None else deadline)
    risks = [task.dt * float(task.rates(path[1:]).sum()) for path in paths]
    best = int(np.argmin(risks))
    multiplier = arrival_multiplier(task, paths[best])
    left = TIME_LIMIT if deadline is None else max(0.0, deadline - time.monotonic())
    return certify(task, risks[best], multiplier, gap=gap, time_limit=left)


def _relaxed_paths(scenario: Scenario, task: Relaxation, deadline: float) -> list[FloatArray]:
    """Locally best paths of the relaxation, in two homotopy classes and near their arrival steps.

    The grid is not that of `Multistart`, whose target is smaller by the margin.
    """
    free = replace(
        GuideTask.from_scenario(scenario, task.start), radius=scenario.target.radius, a_max=np.inf
    )
    multistart = Multistart(scenario, free, make_solver("ipopt"), deadline=deadline)
    candidates: list[Candidate] = []
    for path, shifts in zip(best_homotopy_classes(task, 2), ((-1, 0, 1), (0,)), strict=False):
        candidates += multistart.candidates_along(path, [path.arrival + shift for shift in shifts])
    return [integrate(task.start, c.velocities, task.dt) for c in candidates if np.isfinite(c.risk)]


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
        Its hazard must provide `single_agent_rates_below`.
    best : float
        Risk of a known path of the relaxation.
    multiplier : float
        Minus the derivative of that risk with respect to the target's radius. Any value is valid;
        with a good one the bound converges to `best` as the square of the spacing.
    gap : float
        Value of (best - bound) / best at which to stop.
    time_limit : float
        Seconds.
    first_nodes, max_nodes : int
        Maximum number of nodes of the first grid, if the stride can be chosen so, and of any grid.
    """
    started = time.perf_counter()
    grid: Grid | None = Grid.finest(task, first_nodes)
    levels: list[Level] = []
    bound, reason = 0.0, ""
    while grid is not None:
        level_started = time.perf_counter() - started
        stage_costs = StageCosts(grid, multiplier=multiplier)
        to_go = costs_to_go(stage_costs)
        slack = rounding(stage_costs, best)
        bound = max(bound, min(best, least_cost(stage_costs, to_go)) - slack)
        seconds = time.perf_counter() - started
        levels.append(Level(grid.stride, grid.reach, grid.spacing, grid.size, bound, seconds))
        if bound >= (1 - gap) * best:
            reason = f"the gap of {gap:g} is reached"
            break
        if slack > 0.1 * gap * best and bound > best - 2 * slack:
            reason = "the remaining gap is within rounding errors"
            break
        refined = _refined(stage_costs, to_go, best + slack, max_nodes)
        now = time.perf_counter() - started
        if refined is None:
            reason = f"the next grid has more than {max_nodes:,} nodes"
        elif now + (now - level_started) * refined.size / max(grid.size, 1) > time_limit:
            reason, refined = (
                f"the next grid would exceed the time limit of {time_limit:.3g} s",
                None,
            )
        grid = refined
    return Certificate(bound, best, reason, tuple(levels), time.perf_counter() - started)


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
    """For every step, the least cost of the paths through every node."""
    for come, go in zip(costs_to_come(stage_costs), to_go, strict=True):
        yield [a + b for a, b in zip(come, go, strict=True)]


def _strided_totals(stage_costs: StageCosts, to_go: Values) -> Iterator[list[FloatArray]]:
    """For the steps of every sample, a bound on the risk of the guides near every node.

    All samples of a guide's m paths taken within those steps are within k nodes of its position at
    any of them; a path that has already ended took its last sample within 2 k.
    """
    grid = stage_costs.grid
    start = single_node((0, 0))
    last: tuple[Block, ...] = (start,)
    ended = [stage_costs.terminal(start)]
    for sample, come in enumerate(costs_to_come(stage_costs)):
        blocks = grid.blocks[sample]
        through = [a + b for a, b in zip(come, to_go[sample], strict=True)]
        yield [
            np.minimum(
                minimum_within_reach(through, blocks, block, grid.reach),
                minimum_within_reach(ended, last, block, 2 * grid.reach),
            )
            for block in blocks
        ]
        ended = [
            before + cost + stage_costs.terminal(block)
            for before, cost, block in zip(come, stage_costs.nodes[sample], blocks, strict=True)
        ]
        last = blocks


def arrival_multiplier(task: Relaxation, positions: FloatArray) -> float:
    """Decrease of the risk of a locally best path per increase of the target's radius.

    From its optimality conditions: with a_t the derivative of the risk with respect to a common
    shift of X(t+1), ..., X(T), and n the outward direction at the rim, a_t + multiplier n vanishes
    in every component of V(t) that is not at its limit, and points outwards in the others.

    Parameters
    ----------
    task : Relaxation
    positions : (T+1, 2)
        Of a path without acceleration limits.

    Returns
    -------
    float
        At least 0; any value is valid for `certify`.
    """
    outward = positions[-1] - task.center
    distance = float(np.hypot(*outward))
    if distance < 0.999 * task.radius:  # the arrival constraint is inactive
        return 0.0
    normal = np.broadcast_to(outward / distance, positions[1:].shape)
    shift = 1e-6 * task.step * np.eye(2)
    rates = [task.rates(positions[1:, None] + sign * shift) for sign in (1, -1)]
    slopes = task.dt * (rates[0] - rates[1]) / (2e-6 * task.step)
    gradients = np.cumsum(slopes[::-1], axis=0)[::-1]
    moves = np.diff(positions, axis=0)
    free = np.abs(moves) < task.step * (1 - 1e-4)
    weight = float((normal[free] ** 2).sum())
    if weight > 1e-6:
        return max(0.0, float(-(gradients * normal)[free].sum()) / weight)
    toward = ~free & (np.sign(moves) * normal < -1e-6)
    needed = gradients[toward] / -normal[toward]
    return max(0.0, float(needed.max(initial=0.0)))

"""The proven lower bound: grids that are refined where a better guide may still be."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field

import numpy as np

from ...hazard.lower_bounds import cap_radius
from ...typing import BoolArray, FloatArray
from .dynamic_programming import StageCosts, Values, backward, forward, least, point, spread
from .grid import UNIT, Block, Grid, Relaxation, corners, whole_size

FIRST = 400_000
"""Nodes of the first grid, at the most where merging steps can keep it so."""

MAX_ITERATIONS = 10_000_000
"""Nodes of any grid, over all steps: at most three numbers each are kept, 240 MB."""


@dataclass(frozen=True)
class Level:
    """One grid of a refinement.

    Parameters
    ----------
    merged, reach : int
        Time steps a sample, and nodes a sample.
    spacing : float
        Side of a cell.
    nodes : int
        Over all samples.
    bound : float
        On the risk of any guide, by this grid.
    seconds : float
        Since the start.
    """

    merged: int
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
        No path that obeys the speed limit and is in the target at step N or before has less risk.
    best : float
        Risk of the best such path that is known: the least risk lies between the two.
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
        """(best - bound) / best: how much of the gap is the certificate's own."""
        return (self.best - self.bound) / self.best if self.best > 0 else 0.0

    @property
    def survival(self) -> float:
        """exp(-best)."""
        return math.exp(-self.best)

    def as_dict(self) -> dict[str, object]:
        """Plain values, for a record."""
        return asdict(self) | {"gap": self.gap}


def first_grid(task: Relaxation, most: int = FIRST) -> Grid:
    """The finest whole grid of at most `most` nodes, merging steps if it must."""
    merged = 1
    while whole_size(task, merged, 1) > most and merged < task.steps:
        merged *= 2
    reach = 1
    while reach < 64 and whole_size(task, merged, 2 * reach) <= most:
        reach *= 2
    return Grid.whole(task, merged, reach)


def certify(
    task: Relaxation,
    best: float,
    multiplier: float = 0.0,
    *,
    gap: float = 0.01,
    time_limit: float = 60.0,
    first: int = FIRST,
    most: int = MAX_ITERATIONS,
) -> Certificate:
    """Bound on the risk of all guides, refined until it is within `gap` of the best known risk.

    Parameters
    ----------
    task : Relaxation
        Of a hazard whose `lone_rates_below` knows bounds.
    best : float
        Risk of a known path of the relaxation.
    multiplier : float
        Its derivative by the target's radius, the sign turned; any value is valid, a good one
        makes the bound come up to `best` as the square of the spacing.
    gap : float
        (best - bound) / best at which to stop.
    time_limit : float
        Seconds.
    first, most : int
        Nodes of the first grid, at the most where merging steps can keep it so, and of any.
    """
    started = time.perf_counter()
    grid: Grid | None = first_grid(task, first)
    levels: list[Level] = []
    bound, reason = 0.0, ""
    while grid is not None:
        begun = time.perf_counter() - started
        prices = StageCosts(grid, multiplier=multiplier)
        values = backward(prices)
        slack = rounding(prices, best)
        bound = max(bound, min(best, least(prices, values)) - slack)
        seconds = time.perf_counter() - started
        levels.append(Level(grid.merged, grid.reach, grid.spacing, grid.size, bound, seconds))
        if bound >= (1 - gap) * best:
            reason = f"the gap of {gap:g} is reached"
            break
        if slack > 0.1 * gap * best and bound > best - 2 * slack:
            reason = "rounding errors are all that is left of the gap"
            break
        refined = _refined(prices, values, best + slack, most)
        now = time.perf_counter() - started
        if refined is None:
            reason = f"the next grid has more than {most:,} nodes"
        elif now + (now - begun) * refined.size / max(grid.size, 1) > time_limit:
            reason, refined = f"the next grid would exceed the time limit of {time_limit:g} s", None
        grid = refined
    return Certificate(bound, best, reason, tuple(levels), time.perf_counter() - started)


def _refined(prices: StageCosts, values: Values, threshold: float, most: int) -> Grid | None:
    """The next grid, without the cells in which no better guide can be; None if it is too large."""
    grid = prices.grid
    active: list[tuple[BoolArray, ...]] = []
    cells = 0
    totals = _merged_totals if grid.merged > 1 else _totals
    for blocks, risks in zip(grid.blocks, totals(prices, values), strict=True):
        kept = []
        for block, risk in zip(blocks, risks, strict=True):
            keep = np.zeros(block.cells.shape, bool)
            for corner in corners(risk):
                keep |= corner <= threshold
            kept.append(keep & block.cells)
            cells += int(np.count_nonzero(kept[-1]))
        active.append(tuple(kept))
    if 4 * cells * (1 + (grid.merged > 1)) > most:
        return None
    refined = grid.halved(tuple(active))
    return refined if refined.size <= most else None


def _totals(prices: StageCosts, values: Values) -> Iterator[list[FloatArray]]:
    """For every step, the least cost of the paths through every node."""
    for arriving, going in zip(forward(prices), values, strict=True):
        yield [before + after for before, after in zip(arriving, going, strict=True)]


def _merged_totals(prices: StageCosts, values: Values) -> Iterator[list[FloatArray]]:
    """For the steps of every sample, a bound on the risk of the guides near every node.

    All samples of a guide's m paths that are taken within those steps are within k nodes of its
    place at any of them; a path that has ended before took its last sample within 2 k.
    """
    grid = prices.grid
    start = point((0, 0))
    last: tuple[Block, ...] = (start,)
    ended = [prices.arrivals(start)]
    for sample, arriving in enumerate(forward(prices)):
        blocks = grid.blocks[sample]
        through = [a + b for a, b in zip(arriving, values[sample], strict=True)]
        yield [
            np.minimum(
                spread(through, blocks, block, grid.reach),
                spread(ended, last, block, 2 * grid.reach),
            )
            for block in blocks
        ]
        ended = [
            before + cost + prices.arrivals(block)
            for before, cost, block in zip(arriving, prices.nodes[sample], blocks, strict=True)
        ]
        last = blocks


def rounding(prices: StageCosts, risk: float) -> float:
    """What rounding can add to the cost of a path of at most this risk; proof in the docs."""
    grid = prices.grid
    task = grid.task
    operations = 4 * len(grid.blocks) + 2 * len(task.hazard.radar_positions) + 64
    places = 16 * task.extent / cap_radius(grid.spacing)
    return float(UNIT * (operations + places) * (risk + 2 * prices.largest_arrival))


def arrival_multiplier(task: Relaxation, positions: FloatArray, v_max: float) -> float:
    """How much less the risk of a locally best path would be if the target were wider.

    From its conditions of optimality: with a_t the derivative of the risk by a common shift of
    X(t+1), ..., X(T), and n the outward direction at the rim, a_t + multiplier n vanishes in every
    component of V(t) that is not at its limit, and points outwards in the others.

    Parameters
    ----------
    task : Relaxation
    positions : (T+1, 2)
        Of a path without limits of acceleration.
    v_max : float

    Returns
    -------
    float
        At least 0; any value is valid for `certify`.
    """
    outward = positions[-1] - task.center
    distance = float(np.hypot(*outward))
    if distance < 0.999 * task.radius:  # the rim does not matter
        return 0.0
    normal = np.broadcast_to(outward / distance, positions[1:].shape)
    apart = 1e-6 * task.step * np.eye(2)
    ends = [task.hazard.single_agent_rates(positions[1:, None] + sign * apart) for sign in (1, -1)]
    slopes = task.dt * (ends[0] - ends[1]) / (2e-6 * task.step)
    shifts = np.cumsum(slopes[::-1], axis=0)[::-1]
    velocities = np.diff(positions, axis=0) / task.dt
    free = np.abs(velocities) < v_max * (1 - 1e-4)
    weight = float((normal[free] ** 2).sum())
    if weight > 1e-6:
        return max(0.0, float(-(shifts * normal)[free].sum()) / weight)
    toward = ~free & (np.sign(velocities) * normal < -1e-6)
    needed = shifts[toward] / -normal[toward]
    return max(0.0, float(needed.max(initial=0.0)))

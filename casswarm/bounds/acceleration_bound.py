"""Lower bounds on the risk of guides with limited acceleration, by branch and bound."""

from __future__ import annotations

import heapq
import itertools
import time
from dataclasses import dataclass, replace

import numpy as np

from ..grid.nodes import Relaxation, node_count
from ..typing import FloatArray
from .acceleration_dual import DualFunction, ascend
from .acceleration_limits import AccelerationBound, AccelerationLimits, Region, floored

FIRST_NODES = 200_000
"""Maximum number of nodes of the first regions, if their cells can be chosen so."""

MAX_NODES = 5_000_000
"""Maximum number of nodes of a region."""

_FINE_CELLS = 20_000  # of a region, up to which cells are halved before it is divided
_FIRST, _LATER = 4, 60  # iterations of an ascent
_MAX_REACH = 2**20
_DISCARD = 0.5  # of the requested gap: distance of the risk above which paths are discarded


@dataclass(order=True)
class _Open:
    """A region that may hold better paths, with the multipliers to begin with."""

    bound: float
    number: int
    region: Region
    multipliers: FloatArray
    iterations: int


class _Search:
    """Best-first search of the regions for one that cannot be bounded by the threshold."""

    def __init__(
        self, limits: AccelerationLimits, threshold: float, best: float, deadline: float
    ) -> None:
        self.limits, self.threshold, self.best = limits, threshold, best
        self.deadline = deadline
        self.open: list[_Open] = []
        self._numbers = itertools.count()

    @property
    def bound(self) -> float:
        """Lower bound on the risk of every path."""
        return min(self.threshold, self.open[0].bound) if self.open else self.threshold

    def add(
        self,
        bound: float,
        region: Region,
        multipliers: FloatArray | None = None,
        iterations: int = _LATER,
    ) -> None:
        """Add a region, below whose bound no path in it is."""
        if multipliers is None:
            multipliers = np.zeros(DualFunction(region, self.limits, self.best).count)
        item = _Open(bound, next(self._numbers), region, multipliers, iterations)
        heapq.heappush(self.open, item)

    def advance(self) -> None:
        """Replace the region of the least bound by the parts of it that may hold better paths."""
        item = heapq.heappop(self.open)
        dual = DualFunction(item.region, self.limits, self.best)
        ascent = ascend(
            dual, item.multipliers, self.threshold, self.best, item.iterations, self.deadline
        )
        bound = max(item.bound, ascent.value)
        if bound >= self.threshold:
            return
        region = dual.kept(ascent.multipliers, self.threshold)
        if region is None:
            return
        for part in self._parts(item.region, region, ascent.paths):
            self.add(bound, part, ascent.multipliers)

    def _parts(self, before: Region, region: Region, paths: FloatArray) -> list[Region]:
        """What to bound next instead of a region that was reduced."""
        if region.size < 0.5 * before.size:
            return [region]
        sparse = region.sparse
        if not sparse and 4 * region.size <= _FINE_CELLS:
            return [region.halved()]
        line = (region.widest_gap() if sparse else None) or region.halving_line(paths)
        return [region.halved()] if line is None else list(region.parts(*line))


def bound_with_acceleration(
    task: Relaxation,
    limits: AccelerationLimits,
    best: float,
    *,
    gap: float,
    deadline: float,
    known: float = 0.0,
    first_nodes: int = FIRST_NODES,
) -> AccelerationBound:
    """Bound on the risk of the paths of a relaxation that obey limits of acceleration, too.

    Parameters
    ----------
    task : Relaxation
        With the radius in which paths are to end; its hazard must provide
        `single_agent_rates_below`.
    limits : AccelerationLimits
    best : float
        Risk of a known path; the bound is at most `best`. Any positive number is valid.
    gap : float
        Value of (best - bound) / best at which to stop.
    deadline : float
        A time of `time.monotonic`; a step of the proof that has begun is completed.
    known : float
        A lower bound on the risk of the paths without limits of acceleration.
    first_nodes : int
        Maximum number of nodes of the first regions, if their cells can be chosen so.
    """
    started = time.monotonic()
    scale = float(floored(np.asarray(best), best))
    goal = (1 - gap) * scale
    search = _Search(limits, (1 - _DISCARD * gap) * scale, scale, deadline)
    reach = 1
    while reach < 64 and node_count(task, 1, 2 * reach) <= first_nodes:
        reach *= 2
    reason, regions = f"the gap of {gap:g} is reached", 0
    if node_count(task, 1, reach) > MAX_NODES:
        reason = f"a step has too many positions: more than {MAX_NODES:,} nodes in all"
        return AccelerationBound(known, best, task.radius, reason, 0, 0.0)
    for steps in range(task.steps, 0, -1):
        full = Region.full(replace(task, steps=steps), reach)
        region = None if full is None else full.reached(limits)
        if region is not None:
            search.add(known, region, iterations=_FIRST)
    while search.bound < goal:
        if time.monotonic() > deadline:
            reason = "the time limit is reached"
            break
        if search.open[0].region.reach > _MAX_REACH:
            reason = "the gap is not reached with the smallest cells: a better path may exist"
            break
        search.advance()
        regions += 1
    seconds = time.monotonic() - started
    return AccelerationBound(max(known, search.bound), best, task.radius, reason, regions, seconds)

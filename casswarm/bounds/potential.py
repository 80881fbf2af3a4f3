"""Potentials: functions of time and place that fall by at most the single-agent risk of a step.

A potential w_t, t = 0, ..., N, satisfies, for all positions x and all x' within reach of x,

    (P1)  w_t(x) <= dt b(x') + w_(t+1)(x'),    b the single-agent rate;
    (P2)  w_t(x) <= 0 in the target;
    (P3)  |x - y|^2 >= (|w_t(x) - w_t(y)| / L)^2 - h^2 / 2;
    (P4)  w_t(x) - w_(t+1)(x') <= d.

w_t(x) is the *level* of a member at x, L the *slope*, and d the *largest drop* of a step. The
largest function with (P1) and (P2) is the value function. Derived in ``docs/success-bound.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..grid.dynamic_programming import StageCosts, rounding
from ..grid.nodes import UNIT, CellBlock, Grid, NodeBlock, Relaxation, bilinear, box_extremum
from ..hazard.rate_bounds import LeastRate
from ..typing import FloatArray
from .level_game_kernels import limit_slope

MAX_NODES = 1_000_000
"""Default maximum number of nodes of a potential, over all steps."""

_MAX_REACH = 16
_CHAMFER = math.sqrt(4 - 2 * math.sqrt(2)) * (1 + 1e-12)
"""Largest ratio of the length of a path along straight and diagonal edges to the distance."""

_HIGHEST = 64.0
"""Levels are cut off here: exp(-64) is below the rounding errors of a probability."""


@dataclass(frozen=True, eq=False)
class Potential:
    """Levels on a rectangle of grid nodes; in between bilinear, and constant outwards.

    `slack` bounds their rounding errors: (P1) and (P2) hold for w_t - slack (N + 1 - t) / (N + 1).
    """

    task: Relaxation  # its start is node (0, 0)
    starts: FloatArray = field(repr=False)  # (n, 2), initial positions of the members
    reach: int  # k, nodes by which a coordinate changes in a step: the spacing is h = s / k
    low: tuple[int, ...]  # index of the first node
    values: tuple[FloatArray, ...] = field(repr=False)  # (nx, ny), for steps 0 to N
    slope: float  # L, infinite without a limit
    largest: float  # d, infinite without a limit
    slack: float

    @property
    def spacing(self) -> float:
        """h, the side of a cell."""
        return self.task.step / self.reach

    def levels(self, step: int, positions: FloatArray) -> FloatArray:
        """Lower bounds (B,) of the levels at positions (B, 2) at a step, rounding included."""
        nodes = (positions - self.task.start) / self.spacing - self.low
        last = np.array(self.values[0].shape) - 1
        nodes = np.clip(nodes, 0.0, last)
        cells = np.minimum(np.floor(nodes).astype(int), last - 1)
        return bilinear(self.values[step], cells, nodes - cells) - self.slack

    @cached_property
    def start_levels(self) -> FloatArray:
        """Levels (n,) of the members at step 0."""
        return self.levels(0, self.starts)

    def least_squared_distance(self, gaps: FloatArray) -> FloatArray:
        """Least squared distance of two members whose levels differ by at least `gaps`."""
        return np.maximum(0.0, (gaps / self.slope) ** 2 - 0.5 * self.spacing**2)


class PotentialFamily:
    """The potentials of a scenario on one grid, by slope.

    Parameters
    ----------
    task : Relaxation
        Whose hazard provides lower bounds of single-agent rates.
    starts : (n, 2)
    max_nodes : int
        Maximum number of nodes over all steps, if the coarsest grid has no more.
    multiplier : float
        Of arrival, as of `StageCosts`.
    """

    def __init__(
        self,
        task: Relaxation,
        starts: FloatArray,
        max_nodes: int = MAX_NODES,
        multiplier: float = 0.0,
    ) -> None:
        # node values that are not negative, whatever the hazard: see `Relaxation.rates_below`
        self.task = replace(task, least=LeastRate(np.zeros(1), np.ones(1)))
        self.starts, self.multiplier = starts, multiplier
        self.reach = 1
        while self.reach < _MAX_REACH and self._count(2 * self.reach) <= max_nodes:
            self.reach *= 2

    @cached_property
    def _block(self) -> CellBlock:
        return CellBlock.full(self._rectangle(self.reach))

    @cached_property
    def _stage_costs(self) -> StageCosts:
        return StageCosts(Grid(self.task, 1, self.reach, ((self._block,),)), True, self.multiplier)

    @cached_property
    def _costs(self) -> FloatArray:
        """Lower bounds of the single-agent risk of a step to every node."""
        costs = self._stage_costs.nodes[0][0] * (1 - 1e-9)
        costs[[0, -1]] = 0.0  # what is outside counts as at the edge
        costs[:, [0, -1]] = 0.0
        return np.asarray(costs)

    @cached_property
    def _slack(self) -> float:
        stage_costs = self._stage_costs
        per_path = rounding(stage_costs, _HIGHEST, interpolated=True)
        largest = _HIGHEST + stage_costs.max_terminal
        return per_path + 64 * UNIT * (self.task.steps + 1) * largest

    @property
    def size(self) -> int:
        """Number of nodes over all steps."""
        return self._count(self.reach)

    def _count(self, reach: int) -> int:
        return self._rectangle(reach).size * self.task.steps

    def _rectangle(self, reach: int) -> NodeBlock:
        """Nodes of the positions on paths from the starts to the target, and of a margin."""
        task = self.task
        spacing = task.step / reach
        near = self.starts[task.reachable(self.starts, task.steps)]
        offsets = ((near if len(near) else self.starts[:1]) - task.start) / spacing
        low, high = np.floor(offsets.min(axis=0)), np.ceil(offsets.max(axis=0))
        center, radius = (task.center - task.start) / spacing, task.radius / spacing
        ahead = reach * np.arange(1, task.steps + 1)[:, None]
        back = ahead[::-1] - reach
        first = np.maximum(np.floor(center - radius) - back, low - ahead).min(axis=0)
        last = np.minimum(np.ceil(center + radius) + back, high + ahead).max(axis=0)
        margin = 2 * reach  # that leaving and coming back does not pay where a slope limits levels
        return NodeBlock.between(np.minimum(first, low) - margin, np.maximum(last, high) + margin)

    def potential(self, slope: float = math.inf, largest: float = math.inf) -> Potential:
        """The largest potential on the nodes with this slope and largest drop: equation (S1)."""
        edge = slope / _CHAMFER * (self.task.step / self.reach)
        nodes = self._block.nodes
        highest = np.minimum(self._stage_costs.terminal(nodes), _HIGHEST)
        costs = np.minimum(self._costs, largest)
        values: list[FloatArray] = []
        for _ in range(self.task.steps + 1):
            level = highest.copy()
            if values:
                after = box_extremum(values[-1] + costs, nodes, nodes, self.reach)
                np.minimum(level, after, out=level)
            if math.isfinite(slope):
                limit_slope(level, edge, math.sqrt(2) * edge)
            values.append(level)
        return Potential(
            *(self.task, self.starts, self.reach, nodes.first, tuple(values[::-1])),
            *(slope, largest, self._slack),
        )

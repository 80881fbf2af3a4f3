"""The value function: the least risk to go from any state, between two bounds, and its map."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import PlanningError
from ..scenario import Scenario
from ..scenario.scenario_files import require_scenario
from ..scenario.variations import require_default
from ..typing import BoolArray, FloatArray
from .dynamic_programming import StageCosts, Values, costs_to_go, rounding
from .nodes import ANYWHERE, Grid, NodeBlock, Relaxation, box_extremum, multilinear, node_count

_MAX_NODES = 2_500_000  # of the grid, over all steps
_MAX_REACH = 1024  # nodes that a step spans; values are interpolated as far around the grid
_TIE = 1e-9  # relative: nodes at the edge of reach, for positions that are nodes but for rounding
_CHUNK = 2**21  # nodes at once, of all positions: bounds memory

_MAP_NODES = 150  # along an axis
_MAP_ARROWS = slice(4, None, 9)  # of the nodes, along an axis


@dataclass(frozen=True, eq=False)
class ValueFunction:
    """Least risk to go of a single agent, W_t(x), without acceleration limits.

    W_t(x) = min over y in x + [-s, s]^2 of (dt rate(y) + W_(t+1)(y)), and 0 in the target, where a
    guide ends; infinite where the target cannot be reached by step N.

    Parameters
    ----------
    grid : Grid
        Of all positions from which the target can be reached in time.
    upper : values
        Cost to go at every node, its own cost included, of paths along the nodes, which a
        single agent without acceleration limits can follow.
    lower : values or None
        The same of the relaxation; None if the hazard provides no bounds.
    """

    grid: Grid
    upper: Values = field(repr=False)
    lower: Values | None = field(repr=False)

    @classmethod
    def from_scenario(
        cls,
        scenario: Scenario,
        max_nodes: int = _MAX_NODES,
        *,
        certified: bool = True,
        time_limit: float = math.inf,
    ) -> ValueFunction:
        """Value function of a scenario, on the finest grid of at most `max_nodes` nodes.

        Lower bounds are computed if `certified` and if the hazard provides them. Where members
        differ, it is that of the guide's kind.

        Raises
        ------
        PlanningError
            Even the coarsest grid has too many nodes, because there are too many steps; or the
            value function is not complete after `time_limit` seconds.
        """
        require_scenario("ValueFunction.from_scenario", scenario)
        for key in ("time.substeps", "target.other", "swarm.speed"):
            require_default(scenario, key, "the value function")
        scenario = scenario.for_guide
        deadline = time.monotonic() + time_limit
        grid = value_grid(scenario, max_nodes)
        lower = StageCosts(grid) if certified and grid.task.bounded else None
        try:
            return cls(
                grid,
                costs_to_go(StageCosts(grid, certified=False, inside=True), deadline),
                None if lower is None else costs_to_go(lower, deadline),
            )
        except TimeoutError:
            raise PlanningError(
                f"the value function is not complete after {time_limit:g} s: raise the time limit, "
                "or choose a larger time.dt or a smaller t_f",
                time_limit=time_limit,
            ) from None

    def bounds(self, step: int, positions: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Proven bounds of the least risk to go, (...) each, at positions (..., 2) at a step.

        The lower bound is 0 if the hazard provides no bounds; the upper bound is, but for rounding,
        the risk of following `velocities`, and infinite where no path along the nodes arrives.
        """
        points = np.asarray(positions, float)
        flat = points.reshape(-1, 2)
        arrived = self._in_target(flat)
        high = np.where(arrived, 0.0, self._best_nodes(self.upper, step, flat)[0])
        low = np.zeros(len(flat))
        if self.lower is not None:
            low = self._interpolated(self.lower, step + 1, flat, self.grid.reach)
            low = np.where(arrived, 0.0, np.maximum(0.0, low - self._rounding))
        remaining = max(0, self.grid.task.steps - step)
        low[~arrived & ~self.grid.task.reachable(flat, remaining)] = np.inf
        return low.reshape(points.shape[:-1]), high.reshape(points.shape[:-1])

    def velocities(self, step: int, positions: ArrayLike) -> FloatArray:
        """The feedback guide: the best next velocities (..., 2) at positions (..., 2) at a step.

        They lead to the best node within reach; straight towards the target if there is none, and
        they are zero in the target.
        """
        points = np.asarray(positions, float)
        flat = points.reshape(-1, 2)
        task = self.grid.task
        risk, goals = self._best_nodes(self.upper, step, flat)
        goals[~np.isfinite(risk)] = task.center
        goals = np.where(self._in_target(flat)[:, None], flat, goals)
        velocities = np.clip((goals - flat) / task.dt, -task.speed, task.speed)
        return np.asarray(velocities.reshape(points.shape))

    def to_go(self, step: int, positions: FloatArray) -> FloatArray:
        """Interpolated risk to go (...) at positions (..., 2) at a step; not a bound."""
        flat = positions.reshape(-1, 2)
        risk = self._interpolated(self.upper, step + 1, flat, self.grid.reach)
        return np.where(self._in_target(flat), 0.0, risk).reshape(positions.shape[:-1])

    def after(self, step: int, positions: FloatArray) -> FloatArray:
        """Interpolated risk (...) of being at positions (..., 2) at a step and of what follows.

        Not a bound; infinite where no path along the nodes arrives.
        """
        flat = positions.reshape(-1, 2)
        task, arrived = self.grid.task, self._in_target(flat)
        risk = self._interpolated(self.upper, step, flat, reach=0)
        if arrived.any():
            risk[arrived] = task.dt * task.after(step).rates(flat[arrived])
        return risk.reshape(positions.shape[:-1])

    @cached_property
    def _rounding(self) -> float:
        """Bound on the rounding of lower bounds."""
        arrays = [array for arrays in self.lower or () for array in arrays]
        largest = max((float(a[np.isfinite(a)].max(initial=0.0)) for a in arrays), default=0.0)
        return rounding(StageCosts(self.grid), largest, interpolated=True)

    def _in_target(self, flat: FloatArray) -> BoolArray:
        task = self.grid.task
        return np.asarray(np.hypot(*(flat - task.center).T) <= task.radius)

    def _at(self, values: Values, step: int) -> tuple[NodeBlock, FloatArray] | None:
        """Nodes and values of a step; None outside 1..N."""
        if not 1 <= step <= len(values):
            return None
        return self.grid.nodes[step - 1][0], values[step - 1][0]

    def _interpolated(self, values: Values, step: int, flat: FloatArray, reach: int) -> FloatArray:
        """Least values of a step within `reach` nodes of every node, interpolated at (B, 2)."""
        at = self._at(values, step)
        if at is None:
            return np.full(len(flat), np.inf)
        around = at[0].grown(reach)
        least = box_extremum(at[1], at[0], around, reach) if reach else at[1]
        nodes = (flat - self.grid.task.start) / self.grid.spacing - around.first
        cells = np.floor(nodes).astype(int)
        return multilinear(least, cells, nodes - cells)

    def _best_nodes(
        self, values: Values, step: int, flat: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Least value of the next step within reach of positions (B, 2), and its nodes if any."""
        following = self._at(values, step + 1)
        risk, goals = np.full(len(flat), np.inf), flat.copy()
        if following is None:
            return risk, goals
        (low, _), array = following
        task, h, k = self.grid.task, self.grid.spacing, self.grid.reach
        at = (flat - task.start) / h - np.array(low)
        limit = k * (1 + _TIE)
        first = np.maximum(0, np.ceil(at - limit)).astype(int)
        last = np.minimum(np.array(array.shape) - 1, np.floor(at + limit)).astype(int)
        height, width = (np.arange(min(2 * k + 1, size)) for size in array.shape)
        count = max(1, _CHUNK // (len(height) * len(width)))
        for begin in range(0, len(flat), count):
            chunk = slice(begin, begin + count)
            rows, columns = first[chunk, :1] + height, first[chunk, 1:] + width
            beyond_rows, beyond_columns = rows > last[chunk, :1], columns > last[chunk, 1:]
            rows[beyond_rows], columns[beyond_columns] = 0, 0
            costs = array[rows[:, :, None], columns[:, None, :]]
            costs[beyond_rows] = np.inf
            costs.transpose(0, 2, 1)[beyond_columns] = np.inf
            risk[chunk] = costs.min(axis=(1, 2))
            best = np.divmod(costs.reshape(len(costs), -1).argmin(axis=1), len(width))
            goals[chunk] = task.start + h * (first[chunk] + np.stack(best, axis=1) + low)
        return risk, goals


def value_grid(scenario: Scenario, max_nodes: int = _MAX_NODES) -> Grid:
    """The finest grid of at most `max_nodes` nodes, or of ten times as many if it must be.

    A step at full speed spans at most 1024 nodes along an axis.

    Raises
    ------
    PlanningError
        Even the coarsest grid has too many nodes, because there are too many steps.
    """
    task = Relaxation.from_scenario(scenario)
    reach, limit = 1, 10 * _MAX_NODES
    nodes = node_count(task, 1, reach, ANYWHERE)
    if nodes > max(max_nodes, limit):
        raise PlanningError(
            f"the value function of {task.steps} steps needs {nodes:,} nodes, more than "
            f"{limit:,}; a larger time.dt or a smaller t_f, or a "
            "smaller target.radius, makes it smaller",
            steps=task.steps,
            nodes=nodes,
            max_nodes=limit,
        )
    while 2 * reach <= _MAX_REACH and node_count(task, 1, 2 * reach, ANYWHERE) <= max_nodes:
        reach *= 2
    return Grid.full(task, 1, reach, ANYWHERE)


@dataclass(frozen=True, eq=False)
class CostToGoMap:
    """Survival and next velocities of a single agent in a rectangle of the plane, at one step.

    Parameters
    ----------
    step : int
    low, high : (2,)
        Corners of the rectangle.
    survival : (m, m)
        exp(-upper bound of the risk to go), row by row from below; 0 where no path arrives.
    positions, velocities : (k, 2)
        Some positions, and the best next velocity at each.
    """

    step: int
    low: FloatArray
    high: FloatArray
    survival: FloatArray
    positions: FloatArray
    velocities: FloatArray

    @classmethod
    def from_scenario(
        cls,
        scenario: Scenario,
        contents: Sequence[FloatArray] = (),
        *,
        step: int = 0,
        time_limit: float | None = None,
    ) -> CostToGoMap:
        """Map of a scenario around its target, radars and members, and further points (m, 2) each.

        With the positions of a guide, it covers the area of `casswarm.figures.cost_to_go_map`.

        Raises
        ------
        PlanningError
            As `ValueFunction.from_scenario`, after `time_limit` seconds.

        Examples
        --------
        >>> import casswarm as csw
        >>> costs = csw.CostToGoMap.from_scenario(csw.load_scenario("single-agent"))
        >>> costs.survival.shape
        (150, 150)
        """
        limit = math.inf if time_limit is None else time_limit
        value = ValueFunction.from_scenario(scenario, certified=False, time_limit=limit)
        return cls.from_value_function(
            value, *scenario.extent([*contents, scenario.positions]), step
        )

    @classmethod
    def from_value_function(
        cls, value: ValueFunction, low: FloatArray, high: FloatArray, step: int = 0
    ) -> CostToGoMap:
        """Map of a value function between the corners `low` and `high`."""
        east, north = (np.linspace(low[axis], high[axis], _MAP_NODES) for axis in (0, 1))
        nodes = np.stack(np.meshgrid(east, north), axis=-1)
        positions = nodes[_MAP_ARROWS, _MAP_ARROWS].reshape(-1, 2)
        survival = np.exp(-value.bounds(step, nodes)[1])
        return cls(step, low, high, survival, positions, value.velocities(step, positions))

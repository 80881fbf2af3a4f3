"""The value function: the least risk to go from any place at any step, between two bounds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...errors import PlanningError
from ...typing import FloatArray
from .dynamic_programming import StageCosts, Values, backward
from .grid import UNIT, Grid, Relaxation, whole_size
from .windows import box_minimum

if TYPE_CHECKING:
    from ...scenario import Scenario

_NODES = 2_500_000  # of the grid, over all steps
_TIE = 1e-9  # relative: nodes at the edge of reach, from places that are nodes but for rounding
_ROUNDING = 4096 * UNIT  # relative, of a bound; the sums are short


@dataclass(frozen=True, eq=False)
class ValueFunction:
    """Least risk to go of a lone agent, W_t(x), without limits of acceleration.

    W_t(x) = min over y in x + [-s, s]^2 of (dt rate(y) + W_(t+1)(y)), and 0 in the target, where a
    guide ends; infinite where the target cannot be reached by step N.

    Parameters
    ----------
    grid : Grid
        Of all places from which the target can be reached in time.
    above : values
        Of paths along the nodes, which can be flown: at every node, its own cost and what follows.
    below : values or None
        The same of the relaxation; None where the hazard knows no bounds.
    """

    grid: Grid
    above: Values = field(repr=False)
    below: Values | None = field(repr=False)

    @classmethod
    def of(
        cls, scenario: Scenario, nodes: int = _NODES, *, certified: bool = True
    ) -> ValueFunction:
        """Value function of a scenario, on the finest grid of at most `nodes` nodes.

        `certified` asks for lower bounds too, where the hazard knows them.

        Raises
        ------
        PlanningError
            Not even one node a step is so few: too many steps.
        """
        task = Relaxation.of(scenario)
        reach = 1
        if whole_size(task, 1, reach, from_start=False) > max(nodes, 10 * _NODES):
            raise PlanningError(
                f"the value function of {task.steps} steps needs "
                f"{whole_size(task, 1, 1, from_start=False):,} nodes, more than {10 * _NODES:,}; "
                "a larger time.dt or a smaller t_f makes it smaller"
            )
        while whole_size(task, 1, 2 * reach, from_start=False) <= nodes:
            reach *= 2
        grid = Grid.everywhere(task, reach)
        known = (
            certified
            and scenario.hazard.single_agent_lower_bound(task.center, task.center) is not None
        )
        return cls(
            grid,
            backward(StageCosts(grid, certified=False, inside=True)),
            backward(StageCosts(grid)) if known else None,
        )

    def bounds(self, step: int, positions: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Proven bounds of the least risk to go, (...) each, at positions (..., 2) at a step.

        The lower one is 0 where the hazard knows no bounds; the upper one is, but for rounding, the
        risk of following `velocities`, infinite where the grid knows no way.
        """
        places = np.asarray(positions, float)
        flat = places.reshape(-1, 2)
        arrived = np.hypot(*(flat - self.grid.task.center).T) <= self.grid.task.radius
        low, high = np.zeros(len(flat)), np.zeros(len(flat))
        high[~arrived] = self._window(self.above, step, flat[~arrived])[0]
        if self.below is not None:
            low[~arrived] = self._interpolated(self._spread(self.below, step), flat[~arrived])
            low = np.maximum(0.0, low) * (1 - _ROUNDING)
        low[~arrived & ~self._in_time(step, flat)] = np.inf
        return low.reshape(places.shape[:-1]), high.reshape(places.shape[:-1])

    def velocities(self, step: int, positions: ArrayLike) -> FloatArray:
        """The feedback guide: the best next velocities (..., 2) at positions (..., 2) at a step.

        To the best node within reach; straight towards the target where there is none, and zero in
        the target.
        """
        places = np.asarray(positions, float)
        flat = places.reshape(-1, 2)
        task = self.grid.task
        risk, goals = self._window(self.above, step, flat)
        goals[~np.isfinite(risk)] = task.center
        goals = np.where((np.hypot(*(flat - task.center).T) <= task.radius)[:, None], flat, goals)
        limit = task.step / task.dt
        found = np.clip((goals - flat) / task.dt, -limit, limit)
        return np.asarray(found.reshape(places.shape))

    def to_go(self, step: int, positions: FloatArray) -> FloatArray:
        """Risk to go at positions (..., 2) at a step, interpolated, (...); not a bound."""
        flat = positions.reshape(-1, 2)
        found = self._interpolated(self._spread(self.above, step), flat)
        arrived = np.hypot(*(flat - self.grid.task.center).T) <= self.grid.task.radius
        return np.where(arrived, 0.0, found).reshape(positions.shape[:-1])

    def after(self, step: int, positions: FloatArray) -> FloatArray:
        """Risk of being at positions (..., 2) at a step and of what follows, interpolated, (...).

        Not a bound; infinite where the grid knows no way on.
        """
        flat = positions.reshape(-1, 2)
        task, values = self.grid.task, self._at(self.above, step)
        found = np.full(len(flat), np.inf) if values is None else self._interpolated(values, flat)
        arrived = np.hypot(*(flat - task.center).T) <= task.radius
        if arrived.any():
            found[arrived] = task.dt * task.hazard.single_agent_rates(flat[arrived])
        return found.reshape(positions.shape[:-1])

    def _at(self, values: Values, step: int) -> tuple[tuple[int, int], FloatArray] | None:
        """First node and values of a step 1..N; None where there are none."""
        if not 1 <= step <= len(values) or not values[step - 1]:
            return None
        return self.grid.blocks[step - 1][0].low, values[step - 1][0]

    def _spread(self, values: Values, step: int) -> tuple[tuple[int, int], FloatArray]:
        """First node and least value of the next step within reach of every node."""
        found = self._at(values, step + 1)
        if found is None:
            return (0, 0), np.full((1, 1), np.inf)
        (i, j), array = found
        k = self.grid.reach
        shape = (array.shape[0] + 2 * k, array.shape[1] + 2 * k)
        return (i - k, j - k), box_minimum(array, (-k, -k), shape, k)

    def _interpolated(
        self, known: tuple[tuple[int, int], FloatArray], flat: FloatArray
    ) -> FloatArray:
        """Bilinear interpolation of node values at positions (B, 2); infinite outside."""
        low, array = known
        at = (flat - self.grid.task.start) / self.grid.spacing - np.array(low)
        cell = np.floor(at).astype(int)
        inside = ((cell >= 0) & (cell < np.array(array.shape) - 1)).all(axis=1)
        cell = np.where(inside[:, None], cell, 0)
        weight = at - cell
        found = np.zeros(len(flat))
        if min(array.shape) < 2:
            return np.full(len(flat), np.inf)
        for i in (0, 1):
            for j in (0, 1):
                share = np.abs(1 - i - weight[:, 0]) * np.abs(1 - j - weight[:, 1])
                corner = array[cell[:, 0] + i, cell[:, 1] + j]
                found += np.where(share > 0, share * np.where(share > 0, corner, 0.0), 0.0)
        return np.where(inside, found, np.inf)

    def _window(self, values: Values, step: int, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least value of the next step at nodes within reach of positions (B, 2), and where."""
        found = self._at(values, step + 1)
        risk, goals = np.full(len(flat), np.inf), flat.copy()
        if found is None or not len(flat):
            return risk, goals
        low, array = found
        task, h, k = self.grid.task, self.grid.spacing, self.grid.reach
        at = (flat - task.start) / h - np.array(low)
        within = k * (1 + _TIE)
        first = np.ceil(at - within).astype(int)
        offsets = np.stack(np.meshgrid(*[np.arange(2 * k + 1)] * 2, indexing="ij"), -1)
        offsets = offsets.reshape(-1, 2)
        for begin in range(0, len(flat), 2048):  # bounds memory
            part = slice(begin, begin + 2048)
            nodes = first[part, None] + offsets
            valid = ((nodes >= 0) & (nodes < np.array(array.shape))).all(axis=-1)
            valid &= (np.abs(nodes - at[part, None]) <= within).all(axis=-1)
            nodes = np.where(valid[..., None], nodes, 0)
            costs = np.where(valid, array[nodes[..., 0], nodes[..., 1]], np.inf)
            best = costs.argmin(axis=1)
            rows = np.arange(len(best))
            risk[part] = costs[rows, best]
            chosen = task.start + h * (nodes[rows, best] + np.array(low))
            goals[part] = np.where(np.isfinite(risk[part])[:, None], chosen, flat[part])
        return risk, goals

    def _in_time(self, step: int, flat: FloatArray) -> np.ndarray:
        """Whether the target can be reached from positions (B, 2) by step N."""
        task = self.grid.task
        away = np.abs(flat - task.center) - max(0, task.steps - step) * task.step
        return np.asarray(np.hypot(*np.maximum(away, 0.0).T) <= task.radius)

"""The optimal policy of two members, as far as it is known.

While both are alive, nothing is random: an optimal policy follows one pair of trajectories until a
member is lost, and what a survivor does is a problem of one agent. The policy follows the joint
plan, or the plan that a solve from the best path of the two members' dynamic program leads to,
whichever succeeds more often; survivors replan from where they are. `casswarm.optimal_value` bounds
what this can lose.

In states that are on no plan, it compares manoeuvres of both members, as the feedback policies do
for one, by their exact probabilities and the dynamic program's value where they end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import PlanningError, PolicyError
from ..optimization.solvers import Solver
from ..planning.bounds import PairValueFunction, ValueFunction, require_pair
from ..planning.guide import Guide
from ..planning.joint import PlanTree, alternative_plan, plan_swarm
from ..problems.step import Motion
from ..typing import BoolArray, FloatArray
from .decision import Decision
from .feedback import FeedbackPolicy

if TYPE_CHECKING:
    from ..scenario import Scenario

_MIN_PROBABILITY = 1e-5
"""Probability of a loss from which the survivor replans."""

_EVERY = 2  # of a single agent's target velocities per axis, one in so many is tried for a pair
_AXIS = 9  # number of these


@dataclass(frozen=True, eq=False)
class OptimalPolicy(FeedbackPolicy):
    """Follow the best known plan of two members, and replan after a loss.

    Parameters
    ----------
    tree : PlanTree
        The plan, and those of survivors.
    pair : PairValueFunction
        Of both members.
    """

    tree: PlanTree
    pair: PairValueFunction
    name: str = "optimal"

    @classmethod
    def from_scenario(cls, scenario: Scenario, guide: Guide, solver: Solver) -> OptimalPolicy:
        """The policy of a scenario of two members; the guide provides V(-1) if it must.

        Raises
        ------
        PolicyError
            Another number of members, or rates without bounds for pairs.
        """
        cls.require_pair(scenario)
        pair = PairValueFunction.from_scenario(scenario)
        plan = plan_swarm(scenario, guide=guide)
        plan = alternative_plan(scenario, plan, pair.path(scenario.positions))
        value = ValueFunction.from_scenario(scenario, certified=False)
        tree = PlanTree(scenario, plan, min_probability=_MIN_PROBABILITY)
        return cls(scenario.hazard, Motion.from_scenario(scenario), value, solver, tree, pair)

    @classmethod
    def require_pair(cls, scenario: Scenario) -> None:
        """Raise PolicyError for a scenario that the policy is not for."""
        try:
            require_pair(scenario)
        except PlanningError as error:
            raise PolicyError(f"policy 'optimal': {error}", policy="optimal") from None

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Follow the plan of every state; `Decision.fallbacks` marks states that were replanned."""
        if alive.shape[1] != 2:
            raise PolicyError(
                f"policy 'optimal' is for 2 members, the swarm has {alive.shape[1]}",
                policy=self.name,
                members=alive.shape[1],
            )
        velocities = np.zeros_like(positions)
        failures, fallbacks = np.zeros((2, len(alive)), np.int64)
        elsewhere = np.zeros(len(alive), bool)
        for state, living in enumerate(alive):
            members = tuple(np.flatnonzero(living).tolist())
            if not members:
                continue
            planned = self.tree.follow(
                step, members, positions[state, living], previous_velocities[state, living]
            )
            if planned is None:
                elsewhere[state] = True
            else:
                velocities[state, living], fallbacks[state], failures[state] = planned
        both = elsewhere & alive.all(axis=1)
        for state in np.flatnonzero(both):
            velocities[state] = self._best_pair(step, positions[state], previous_velocities[state])
        single = (elsewhere & ~both)[:, None] & alive
        if single.any():
            goals, _ = self.best_steps(step, positions[single], previous_velocities[single])
            velocities[single] = self.motion.toward(
                positions[single], previous_velocities[single], goals
            )
        infeasible = np.zeros(len(alive), np.int64)
        return Decision(velocities, infeasible, failures, fallbacks)

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.intp]:
        """No member leads: -1 in every state."""
        return np.full(len(alive), -1)

    def _best_pair(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray
    ) -> FloatArray:
        """Velocities (2, 2) of the first step of the best manoeuvres from one state."""
        paths = self._manoeuvres(step, positions, previous_velocities)  # (K, 2, m, 2)
        if step >= self.value.grid.task.steps:
            return np.zeros((2, 2))
        axis = np.arange(0, _AXIS, _EVERY)
        paths = paths[:, :, (_AXIS * axis[:, None] + axis).ravel()]
        success = self._successes(step, paths)
        if success.max() <= 0.0:
            return self.motion.toward(positions, previous_velocities, self.value.grid.task.center)
        best = np.unravel_index(int(success.argmax()), success.shape)
        goals = paths[0, [0, 1], list(best)]
        return self.motion.toward(positions, previous_velocities, goals)

    def _successes(self, step: int, paths: FloatArray) -> FloatArray:
        """Success probabilities (m, m) of all pairs of manoeuvres (K, 2, m, 2)."""
        task, count = self.value.grid.task, paths.shape[2]
        steps = min(len(paths), task.steps - step)
        success, alive = np.zeros((count, count)), np.ones((count, count))
        inside = ((paths - task.center) ** 2).sum(axis=-1) <= task.radius**2
        for k in range(steps):
            at = step + 1 + k
            first, second = (paths[k, member] for member in (0, 1))
            pairs = np.stack(
                [np.repeat(first, count, axis=0), np.tile(second, (count, 1))], axis=1
            )
            arrives = inside[k, 0][:, None] | inside[k, 1]
            if k == steps - 1 and not arrives.all():
                rest = self.pair.after(at, pairs).reshape(count, count)
                success += np.where(arrives, 0.0, alive * rest)
                alive = np.where(arrives, alive, 0.0)
            rates = self.hazard.rates(pairs, np.ones(2, bool)).reshape(count, count, 2)
            p1, p2 = np.moveaxis(np.exp(-task.dt * rates), 2, 0)
            one, two = (np.exp(-self.value.to_go(at, x)) for x in (first, second))
            success += alive * (p1 * (1 - p2) * one[:, None] + p2 * (1 - p1) * two)
            alive = alive * p1 * p2
            success += np.where(arrives, alive, 0.0)
            alive = np.where(arrives, 0.0, alive)
        return success

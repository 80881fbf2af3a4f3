"""Policies that follow planned paths: each member's own, a joint plan, or the optimum of two.

**Two members.** While both are alive, nothing is random: an optimal policy follows one pair of
trajectories until a member is lost, and what the survivor then does is a problem of one agent. So
the policy follows the joint plan, or the plan that a solve from the best path of the two members'
dynamic program leads to, whichever succeeds more often, and a survivor replans from where it is.
`casswarm.optimal_value` bounds what any other policy could gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from typing_extensions import override

from ..bounds import PairValueFunction, require_pair
from ..errors import PlanningError, PolicyError
from ..guide.guide import Guide
from ..joint import PlanTree, SwarmPlan, alternative_plan, plan_swarm
from ..motion.step import Motion
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy

if TYPE_CHECKING:
    from ..scenario import Scenario


_ON_PLAN = 1e-9
"""Distance from the planned position and velocity, in units of v_max dt and v_max, up to which a
member takes exactly the planned velocity."""


@dataclass(frozen=True, eq=False)
class NaivePolicy(Policy):
    """Independent planning, the paper's baseline (section V.B, Figure 4).

    Every member moves to its own guide's next point, as close as the limits allow. One whose
    planning failed heads straight for the target, and counts as a failure.

    Parameters
    ----------
    motion : Motion
    guides : sequence of n Guide
        A guide for every member, from its initial position.
    """

    motion: Motion
    guides: Sequence[Guide]
    name: str = "naive"

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        _require_members(self.name, "plan of separate guides", len(self.guides), alive)
        goals = np.stack([g.reference(step + 1) if g.arrives else g.center for g in self.guides])
        unplanned = np.array([not guide.arrives for guide in self.guides])
        velocities = self.motion.toward(positions, previous_velocities, goals)
        infeasible = alive & ~unplanned & self.motion.misses(positions, velocities, goals)
        failures = (alive & unplanned).any(axis=1).astype(np.int64)
        velocities = np.where(alive[..., None], velocities, 0.0)
        return Decision(velocities, infeasible.sum(axis=1), failures, np.zeros_like(failures))


def _require_members(policy: str, kind: str, n: int, alive: BoolArray) -> None:
    if alive.shape[1] != n:
        raise PolicyError(
            f"this {kind} is for {n} members, the swarm has {alive.shape[1]}: make a plan for this "
            "scenario",
            policy=policy,
            expected=n,
            members=alive.shape[1],
        )


@dataclass(frozen=True, eq=False)
class JointPolicy(Policy):
    """Open loop: every member follows its path in a plan.

    From the plan's own initial state, members are on their paths while they live, and
    `casswarm.evaluate` gives the plan's own distribution. From elsewhere they move to the next
    point of their paths as directly as the limits allow; those that do not reach it count as
    infeasible.

    Parameters
    ----------
    motion : Motion
    planned_positions, planned_velocities : (T+1, n, 2), (T, n, 2)
        X(0..T), V(0..T-1).
    initial_velocities : (n, 2)
        V(-1).
    """

    motion: Motion
    planned_positions: FloatArray
    planned_velocities: FloatArray
    initial_velocities: FloatArray
    name: str = "joint"

    @classmethod
    def from_plan(cls, plan: SwarmPlan, name: str = "joint") -> JointPolicy:
        """The policy that follows a plan."""
        return cls(plan.motion, plan.positions, plan.velocities, plan.initial_velocities, name)

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        steps, n = self.planned_velocities.shape[:2]
        _require_members(self.name, "joint plan", n, alive)
        goals = np.broadcast_to(self.planned_positions[min(step + 1, steps)], positions.shape)
        velocities = self.motion.toward(positions, previous_velocities, goals)
        if step < steps:
            on_plan = self._on_plan(step, positions, previous_velocities)
            velocities = np.where(on_plan[..., None], self.planned_velocities[step], velocities)
        infeasible = alive & self.motion.misses(positions, velocities, goals)
        velocities = np.where(alive[..., None], velocities, 0.0)
        none = np.zeros((2, len(alive)), np.int64)
        return Decision(velocities, infeasible.sum(axis=1), *none)

    def _on_plan(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray
    ) -> BoolArray:
        """Members (B, n) that have the position and the velocity of the plan."""
        v_max, dt = self.motion.v_max, self.motion.dt
        velocity = self.planned_velocities[step - 1] if step else self.initial_velocities
        at_position = np.abs(positions - self.planned_positions[step]) <= _ON_PLAN * v_max * dt
        at_velocity = np.abs(previous_velocities - velocity) <= _ON_PLAN * v_max
        return np.asarray((at_position & at_velocity).all(axis=-1))


@dataclass(frozen=True, eq=False)
class ReplanningPolicy(Policy):
    """Follow a joint plan; where members were lost, follow a new plan for the others.

    `casswarm.joint.replan` describes the situations for which plans are made. A state that
    is on no plan, such as one that a user constructs, is steered back to the first plan.
    `Decision.fallbacks` marks states that were replanned.

    Parameters
    ----------
    tree : PlanTree
        Stores every plan, so that each situation is solved once.
    open_loop : JointPolicy
        Policy of the first plan.
    """

    tree: PlanTree
    open_loop: JointPolicy
    name: str = "joint-replanning"

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        open_loop = self.open_loop.decide_batch(step, positions, previous_velocities, alive)
        velocities, infeasible = open_loop.velocities.copy(), open_loop.infeasible.copy()
        failures, fallbacks = np.zeros((2, len(alive)), np.int64)
        for state, living in enumerate(alive):
            members = tuple(np.flatnonzero(living).tolist())
            if not members:
                continue
            planned = self.tree.follow(
                step, members, positions[state, living], previous_velocities[state, living]
            )
            if planned is not None:
                velocities[state, living], fallbacks[state], failures[state] = planned
                infeasible[state] = 0
        return Decision(velocities, infeasible, failures, fallbacks)


_MIN_PROBABILITY = 1e-5
"""Probability of a loss from which the survivor replans."""


@dataclass(frozen=True, eq=False)
class OptimalPolicy(ReplanningPolicy):
    """Follow the best known plan of two members, and replan after a loss.

    In states that are on no plan, members return to the first plan.
    """

    name: str = "optimal"

    @classmethod
    def from_scenario(cls, scenario: Scenario, guide: Guide) -> OptimalPolicy:
        """The policy of a scenario of two members; the guide provides V(-1) if it must."""
        cls.require_pair(scenario)
        value = PairValueFunction.from_scenario(scenario)
        plan = plan_swarm(scenario, guide=guide, certify=False)
        plan = alternative_plan(scenario, plan, value.path(scenario.positions))
        tree = PlanTree(scenario, plan, min_probability=_MIN_PROBABILITY)
        return cls(tree, JointPolicy.from_plan(plan, cls.name))

    @classmethod
    def require_pair(cls, scenario: Scenario) -> None:
        """Raise PolicyError for a scenario that the policy is not for."""
        try:
            require_pair(scenario)
        except PlanningError as error:
            raise PolicyError(f"policy 'optimal': {error}", policy="optimal") from None

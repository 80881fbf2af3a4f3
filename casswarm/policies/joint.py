"""The joint plan as a policy: the living follow their ways, whoever is lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import PolicyError
from ..planning.joint import SwarmPlan
from ..problems.formation import Motion
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy

_ON_PLAN = 1e-9
"""Distance from a plan's place and velocity, in units of v_max and a step of it, up to which a
member is on its way and takes the planned velocity to the last bit."""


@dataclass(frozen=True, eq=False)
class JointPolicy(Policy):
    """Open loop: every member follows its way in a plan.

    From the plan's own initial state, members are on their ways while they live: the law of the
    policy by `casswarm.evaluate` is the plan's. From elsewhere they go to their way's next point as
    directly as the limits allow, and those that do not reach it count as shortfalls.

    Parameters
    ----------
    motion : Motion
    positions, velocities : (T+1, n, 2), (T, n, 2)
        X(0..T), V(0..T-1).
    before : (n, 2)
        V(-1).
    """

    motion: Motion
    positions: FloatArray
    ways: FloatArray
    before: FloatArray
    name: str = "joint"

    @classmethod
    def of(cls, plan: SwarmPlan, name: str = "joint") -> JointPolicy:
        """The policy that follows a plan."""
        return cls(plan.motion, plan.positions, plan.velocities, plan.before, name)

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """To the plan's next places; beyond its last step, to where it ends."""
        n = self.ways.shape[1]
        if alive.shape[1] != n:
            raise PolicyError(
                f"this joint plan is for {n} members, the swarm has {alive.shape[1]}: plan for "
                "this scenario"
            )
        goals = np.broadcast_to(self.positions[min(step + 1, len(self.ways))], positions.shape)
        velocities = self.motion.toward(positions, previous_velocities, goals)
        if step < len(self.ways):
            on_plan = self._on_plan(step, positions, previous_velocities)
            velocities = np.where(on_plan[..., None], self.ways[step], velocities)
        short = alive & self.motion.misses(positions, velocities, goals)
        return Decision(
            np.where(alive[..., None], velocities, 0.0),
            short.sum(axis=1),
            *np.zeros((2, len(alive)), np.int64),
        )

    def _on_plan(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray
    ) -> BoolArray:
        """Which members (B, n) are where the plan has them, with the velocity that it has."""
        motion = self.motion
        velocity = self.ways[step - 1] if step else self.before
        places = np.abs(positions - self.positions[step]) <= _ON_PLAN * motion.v_max * motion.dt
        velocities = np.abs(previous_velocities - velocity) <= _ON_PLAN * motion.v_max
        return np.asarray((places & velocities).all(axis=-1))

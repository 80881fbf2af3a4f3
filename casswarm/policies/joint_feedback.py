"""The joint plan with feedback: after losses the survivors plan again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..planning.joint.replan import PlanTree
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy
from .joint import JointPolicy


@dataclass(frozen=True, eq=False)
class ReplanningPolicy(Policy):
    """Members follow a joint plan; where some were lost, a new one for the others.

    See `casswarm.planning.joint.replan` for which situations are planned for. A state that no plan leads
    to, such as one made up by a caller, is steered back to the first plan.

    Parameters
    ----------
    tree : PlanTree
        Remembers every plan; states that it knows are solved once.
    blind : JointPolicy
        Of the first plan.
    """

    tree: PlanTree
    blind: JointPolicy
    name: str = "joint-replanning"

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """On along the plan of every state; `Decision.fallbacks` tells which were planned anew."""
        blind = self.blind.decide(step, positions, previous_velocities, alive)
        velocities, infeasible = blind.velocities.copy(), blind.infeasible.copy()
        failures, fallbacks = np.zeros((2, len(alive)), np.int64)
        for state, living in enumerate(alive):
            members = tuple(np.flatnonzero(living).tolist())
            if not members:
                continue
            found = self.tree.follow(
                step, members, positions[state, living], previous_velocities[state, living]
            )
            if found is not None:
                velocities[state, living], fallbacks[state], failures[state] = found
                infeasible[state] = 0
        return Decision(velocities, infeasible, failures, fallbacks)

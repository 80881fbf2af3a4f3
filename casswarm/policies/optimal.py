"""The optimal policy of two members, as far as it is known.

While both are alive, nothing is random: an optimal policy follows one pair of trajectories until a
member is lost, and what the survivor then does is a problem of one agent. So the policy follows the
joint plan, or the plan that a solve from the best path of the two members' dynamic program leads
to, whichever succeeds more often, and a survivor replans from where it is. `casswarm.optimal_value`
bounds what any other policy could gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..errors import PlanningError, PolicyError
from ..planning.bounds import PairValueFunction, require_pair
from ..planning.guide import Guide
from ..planning.joint import PlanTree, alternative_plan, plan_swarm
from .planned_paths import JointPolicy, ReplanningPolicy

if TYPE_CHECKING:
    from ..scenario import Scenario

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
        """The policy of a scenario of two members; the guide provides V(-1) if it must.

        Raises
        ------
        PolicyError
            Another number of members, or rates without bounds for pairs.
        """
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

from .initial_guesses import INITIAL_GUESSES, InitialGuess
from .mixture import MixedPlan, plan_swarm_mixture
from .plan_distribution import MAX_EXACT, CasesDistribution, PlanDistribution, plan_law
from .replan import PlanTree
from .search import alternative_plan, plan_swarm
from .solve import JointProblem
from .swarm_plan import SwarmOutcome, SwarmPlan

__all__ = [
    "INITIAL_GUESSES",
    "MAX_EXACT",
    "CasesDistribution",
    "InitialGuess",
    "JointProblem",
    "MixedPlan",
    "PlanDistribution",
    "PlanTree",
    "SwarmOutcome",
    "SwarmPlan",
    "alternative_plan",
    "plan_law",
    "plan_swarm",
    "plan_swarm_mixture",
]

from .initial_guesses import INITIAL_GUESSES, InitialGuess
from .plan_distribution import MAX_EXACT, PlanDistribution
from .replan import PlanTree
from .search import alternative_plan, plan_swarm
from .solve import JointProblem
from .swarm_plan import SwarmOutcome, SwarmPlan

__all__ = [
    "INITIAL_GUESSES",
    "MAX_EXACT",
    "InitialGuess",
    "JointProblem",
    "PlanDistribution",
    "PlanTree",
    "SwarmOutcome",
    "SwarmPlan",
    "alternative_plan",
    "plan_swarm",
]

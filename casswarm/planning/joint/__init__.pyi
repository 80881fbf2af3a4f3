from .alternative import alternative_plan
from .distribution import MAX_EXACT, PlanDistribution
from .initial_guesses import INITIAL_GUESSES
from .optimize import plan_swarm
from .plan import SwarmOutcome, SwarmPlan
from .replan import PlanTree
from .screening import InitialGuess
from .solve import JointProblem

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

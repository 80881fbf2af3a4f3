from .distribution import PlanDistribution
from .initial_guesses import INITIAL_GUESSES, InitialGuess
from .optimize import plan_swarm
from .plan import SwarmOutcome, SwarmPlan
from .replan import PlanTree
from .solve import MAX_EXACT, JointProblem

__all__ = [
    "INITIAL_GUESSES",
    "MAX_EXACT",
    "InitialGuess",
    "JointProblem",
    "PlanDistribution",
    "PlanTree",
    "SwarmOutcome",
    "SwarmPlan",
    "plan_swarm",
]

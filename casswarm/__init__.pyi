from . import comparison, figures, nlp, solvers
from ._util.settings import Accuracy, Execution
from .bounds.risk_bound import Certificate
from .bounds.success_bound import SuccessBound, success_bound
from .chain.distribution import Estimate, OutcomeDistribution
from .chain.markov_chain import MarkovChain
from .chain.prediction import StatePrediction
from .comparison import Comparison, Problem, Tolerances, compare, read_problems
from .errors import (
    CasswarmError,
    CasswarmWarning,
    CheckpointError,
    ComparisonError,
    EnvError,
    ExtraError,
    FolderError,
    HazardError,
    PlanningError,
    PolicyCallError,
    PolicyError,
    ProblemError,
    ScenarioError,
    SolverError,
    WorkerError,
)
from .exploration.frontends import explore
from .figures.animation import animate
from .grid.value_function import CostToGoMap, ValueFunction
from .guide.guide import Candidate, Guide
from .guide.mixture import MixedGuide
from .guide.plan import plan, plan_baseline
from .hazard import CustomHazard, Hazard, KernelHazard, Saturation, SaturationCollision
from .infeasibility import Explanation, explain
from .joint import MixedPlan, SwarmOutcome, SwarmPlan, plan_swarm, plan_swarm_mixture
from .nlp.program import Instances, Nlp
from .nlp.solution import BatchSolution, Residuals, Solution, Status
from .policies import Decision, ParametricPolicy, Policy, as_policy, make_policy
from .scenario import Scenario, builtin_scenarios, load_scenario, save_scenario
from .solvers import FilterInteriorPoint, Solver, make_solver
from .studies.evaluation import (
    SuccessGradient,
    estimate,
    evaluate,
    markov_chain,
    predict_states,
    success_gradient,
)
from .studies.information import value_of_information
from .studies.optimum import OptimalValue, optimal_value
from .studies.posed_problems import formation_problems, guide_problems
from .studies.simulation import Study, runs_needed, simulate
from .studies.sweep import Sweep, sweep
from .studies.training import Training, train
from .typing import Interval, Progress

__version__: str

__all__ = [
    "Accuracy",
    "BatchSolution",
    "Candidate",
    "CasswarmError",
    "CasswarmWarning",
    "Certificate",
    "CheckpointError",
    "Comparison",
    "ComparisonError",
    "CostToGoMap",
    "CustomHazard",
    "Decision",
    "EnvError",
    "Estimate",
    "Execution",
    "Explanation",
    "ExtraError",
    "FilterInteriorPoint",
    "FolderError",
    "Guide",
    "Hazard",
    "HazardError",
    "Instances",
    "Interval",
    "KernelHazard",
    "MarkovChain",
    "MixedGuide",
    "MixedPlan",
    "Nlp",
    "OptimalValue",
    "OutcomeDistribution",
    "ParametricPolicy",
    "PlanningError",
    "Policy",
    "PolicyCallError",
    "PolicyError",
    "Problem",
    "ProblemError",
    "Progress",
    "Residuals",
    "Saturation",
    "SaturationCollision",
    "Scenario",
    "ScenarioError",
    "Solution",
    "Solver",
    "SolverError",
    "StatePrediction",
    "Status",
    "Study",
    "SuccessBound",
    "SuccessGradient",
    "SwarmOutcome",
    "SwarmPlan",
    "Sweep",
    "Tolerances",
    "Training",
    "ValueFunction",
    "WorkerError",
    "animate",
    "as_policy",
    "builtin_scenarios",
    "compare",
    "comparison",
    "estimate",
    "evaluate",
    "explain",
    "explore",
    "figures",
    "formation_problems",
    "guide_problems",
    "load_scenario",
    "make_policy",
    "make_solver",
    "markov_chain",
    "nlp",
    "optimal_value",
    "plan",
    "plan_baseline",
    "plan_swarm",
    "plan_swarm_mixture",
    "predict_states",
    "read_problems",
    "runs_needed",
    "save_scenario",
    "simulate",
    "solvers",
    "success_bound",
    "success_gradient",
    "sweep",
    "train",
    "value_of_information",
]

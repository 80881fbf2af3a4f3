"""casswarm: guiding a swarm of agents through a field of hazards.

The names below are imported when they are first used, so that ``import casswarm`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .planning.bounds.risk_bound import Certificate
    from .planning.bounds.success_bound import SuccessBound, success_bound
    from .planning.bounds.value_function import ValueFunction
    from .chain.stratified import Estimate
    from .chain.distribution import Law
    from .comparison import Comparison, Problem, Tolerances, compare
    from .errors import (
        CasswarmError,
        ComparisonError,
        HazardError,
        PlanningError,
        PolicyError,
        ScenarioError,
        SolverError,
        StoreError,
        WorkerError,
    )
    from .studies.evaluation import estimate, evaluate
    from .figures.animation import animate
    from .planning.guide import Candidate, Guide
    from .hazard import CustomHazard, Hazard, KernelHazard, Saturation, SaturationCollision
    from .studies.pilot import runs_needed
    from .planning.plan import plan
    from .policies import Decision, Policy, as_policy, make_policy
    from .scenario import Scenario, builtin_scenarios, load_scenario, save_scenario
    from .optimization.solution import Residuals, Solution, Status
    from .optimization.solvers import Solver, make_solver
    from .studies.simulation import Study, simulate
    from .planning.joint import SwarmOutcome, SwarmPlan, plan_swarm
    from .studies.sweep import Sweep, sweep

__version__ = version("casswarm")

_FOLDER = Path(__file__).parent
if not (_FOLDER / "problems").exists() and (_FOLDER.parent / "problems").exists():
    # imported from a checkout: there two subpackages stand beside this folder, not in it
    __path__.append(str(_FOLDER.parent))

_HOME = {
    "certificate.refinement": ("Certificate",),
    "certificate.success": ("SuccessBound", "success_bound"),
    "certificate.value": ("ValueFunction",),
    "comparison": ("Comparison", "Problem", "Tolerances", "compare"),
    "chain.hybrid": ("Estimate",),
    "chain.law": ("Law",),
    "evaluation": ("estimate", "evaluate"),
    "errors": (
        "CasswarmError",
        "ComparisonError",
        "HazardError",
        "PlanningError",
        "PolicyError",
        "ScenarioError",
        "SolverError",
        "StoreError",
        "WorkerError",
    ),
    "figures.animation": ("animate",),
    "guide": ("Candidate", "Guide"),
    "hazard": ("CustomHazard", "Hazard", "KernelHazard", "Saturation", "SaturationCollision"),
    "pilot": ("runs_needed",),
    "planning": ("plan",),
    "policies": ("Decision", "Policy", "as_policy", "make_policy"),
    "scenario": ("Scenario", "builtin_scenarios", "load_scenario", "save_scenario"),
    "solution": ("Residuals", "Solution", "Status"),
    "solvers": ("Solver", "make_solver"),
    "study": ("Study", "simulate"),
    "swarm": ("SwarmOutcome", "SwarmPlan", "plan_swarm"),
    "sweeping": ("Sweep", "sweep"),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Candidate",
    "CasswarmError",
    "Certificate",
    "Comparison",
    "ComparisonError",
    "CustomHazard",
    "Decision",
    "Estimate",
    "Guide",
    "Hazard",
    "HazardError",
    "KernelHazard",
    "Law",
    "PlanningError",
    "Policy",
    "PolicyError",
    "Problem",
    "Residuals",
    "Saturation",
    "SaturationCollision",
    "Scenario",
    "ScenarioError",
    "Solution",
    "Solver",
    "SolverError",
    "Status",
    "StoreError",
    "Study",
    "SuccessBound",
    "SwarmOutcome",
    "SwarmPlan",
    "Sweep",
    "Tolerances",
    "ValueFunction",
    "WorkerError",
    "animate",
    "as_policy",
    "builtin_scenarios",
    "compare",
    "estimate",
    "evaluate",
    "load_scenario",
    "make_policy",
    "make_solver",
    "plan",
    "plan_swarm",
    "runs_needed",
    "save_scenario",
    "simulate",
    "success_bound",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

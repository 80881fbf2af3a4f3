"""casswarm: guiding a swarm of agents through a field of hazards.

The names below are imported when they are first used, so that ``import casswarm`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .chain.evaluate import Law
    from .comparison import Comparison, Problem, Tolerances, compare
    from .errors import (
        CasswarmError,
        ComparisonError,
        HazardError,
        PlanningError,
        PolicyError,
        ScenarioError,
        SolverError,
    )
    from .evaluation import evaluate
    from .guide import Candidate, Guide
    from .hazard import CustomHazard, Hazard, KernelHazard, Saturation, SaturationCollision
    from .planning import plan
    from .policies import Decision, Policy, as_policy, make_policy
    from .scenario import Scenario, builtin_scenarios, load_scenario, save_scenario
    from .solution import Residuals, Solution, Status
    from .solvers import Solver, make_solver
    from .study import Study, simulate

__version__ = version("casswarm")

_FOLDER = Path(__file__).parent
if not (_FOLDER / "problems").exists() and (_FOLDER.parent / "problems").exists():
    # imported from a checkout: there two subpackages stand beside this folder, not in it
    __path__.append(str(_FOLDER.parent))

_HOME = {
    "chain.evaluate": ("Law",),
    "evaluation": ("evaluate",),
    "comparison": ("Comparison", "Problem", "Tolerances", "compare"),
    "errors": (
        "CasswarmError",
        "ComparisonError",
        "HazardError",
        "PlanningError",
        "PolicyError",
        "ScenarioError",
        "SolverError",
    ),
    "guide": ("Candidate", "Guide"),
    "hazard": ("CustomHazard", "Hazard", "KernelHazard", "Saturation", "SaturationCollision"),
    "planning": ("plan",),
    "policies": ("Decision", "Policy", "as_policy", "make_policy"),
    "scenario": ("Scenario", "builtin_scenarios", "load_scenario", "save_scenario"),
    "solution": ("Residuals", "Solution", "Status"),
    "solvers": ("Solver", "make_solver"),
    "study": ("Study", "simulate"),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Candidate",
    "CasswarmError",
    "Comparison",
    "ComparisonError",
    "CustomHazard",
    "Decision",
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
    "Study",
    "Tolerances",
    "as_policy",
    "builtin_scenarios",
    "compare",
    "evaluate",
    "load_scenario",
    "make_policy",
    "make_solver",
    "plan",
    "save_scenario",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

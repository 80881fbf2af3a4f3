"""Comparison of solvers: benchmark problems, runs, verification, profiles and a report."""

from .agreement import Agreement
from .convergence import Convergence
from .files import read_problems
from .problem import Problem
from .problems import FAMILIES, make_problems
from .result import Comparison
from .run import DEFAULT, compare
from .scenario_problems import formation_problems, guide_problems
from .verification import Tolerances

__all__ = [
    "DEFAULT",
    "FAMILIES",
    "Agreement",
    "Comparison",
    "Convergence",
    "Problem",
    "Tolerances",
    "compare",
    "formation_problems",
    "guide_problems",
    "make_problems",
    "read_problems",
]

"""Comparison of solvers: benchmark problems, runs, verification, profiles and a report."""

from ..studies.posed_problems import FAMILIES, formation_problems, guide_problems, make_problems
from .agreement import Agreement
from .convergence import Convergence
from .problem import Problem, read_problems
from .result import Comparison
from .run import DEFAULT, compare
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

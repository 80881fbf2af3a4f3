"""Comparison of solvers: benchmark problems, runs, verification, profiles and a report."""

from .problem import Problem
from .problems import FAMILIES, make_problems
from .run import DEFAULT, Comparison, compare
from .verification import Tolerances

__all__ = ["DEFAULT", "FAMILIES", "Comparison", "Problem", "Tolerances", "compare", "make_problems"]

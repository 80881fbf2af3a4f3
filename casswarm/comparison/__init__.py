"""Comparing solvers: problems, cells, verdicts, profiles, and a report of it all."""

from .problems import FAMILIES, Problem, make_problems
from .run import DEFAULT, Comparison, compare
from .verification import Tolerances

__all__ = ["DEFAULT", "FAMILIES", "Comparison", "Problem", "Tolerances", "compare", "make_problems"]

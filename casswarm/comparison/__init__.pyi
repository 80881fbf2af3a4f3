from .families import FAMILIES, Family, make_problems, register_problems
from .problem import Problem, read_problems
from .profiles import (
    data_bands,
    data_profile,
    pairwise_profiles,
    pairwise_wins,
    performance_bands,
    performance_profile,
)
from .ranking import Agreement, rank_solvers
from .report import make_report
from .result import Comparison, Convergence
from .run import DEFAULT, compare
from .verification import Tolerances, costs, summary, verify

__all__ = [
    "DEFAULT",
    "FAMILIES",
    "Agreement",
    "Comparison",
    "Convergence",
    "Family",
    "Problem",
    "Tolerances",
    "compare",
    "costs",
    "data_bands",
    "data_profile",
    "make_problems",
    "make_report",
    "pairwise_profiles",
    "pairwise_wins",
    "performance_bands",
    "performance_profile",
    "rank_solvers",
    "read_problems",
    "register_problems",
    "summary",
    "verify",
]

from .agreement import Agreement
from .convergence import Convergence
from .families import FAMILIES, Family, make_problems, register_problems
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
    "Family",
    "Problem",
    "Tolerances",
    "compare",
    "make_problems",
    "read_problems",
    "register_problems",
]

from . import solvers
from .kkt import kkt_residuals
from .problem import CompiledObjective, Instances, Nlp
from .solution import BatchSolution, Residuals, Solution, Status

__all__ = [
    "BatchSolution",
    "CompiledObjective",
    "Instances",
    "Nlp",
    "Residuals",
    "Solution",
    "Status",
    "kkt_residuals",
    "solvers",
]

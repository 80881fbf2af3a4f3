from .program import CompiledObjective, Instances, Nlp
from .residuals import kkt_residuals
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
]

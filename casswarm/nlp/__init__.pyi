from .program import FeasibleSet, Instances, LagrangianHessian, Nlp
from .residuals import kkt_residuals
from .solution import BatchSolution, Residuals, Solution, Status

__all__ = [
    "BatchSolution",
    "FeasibleSet",
    "Instances",
    "LagrangianHessian",
    "Nlp",
    "Residuals",
    "Solution",
    "Status",
    "kkt_residuals",
]

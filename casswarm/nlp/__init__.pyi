from .nl_reader import read_nl
from .nl_writer import nl_text
from .operations import OPERATIONS, operation_name
from .program import FeasibleSet, Instances, LagrangianHessian, Nlp
from .residuals import kkt_residuals, relative_error
from .solution import BatchSolution, Residuals, Solution, Status

__all__ = [
    "OPERATIONS",
    "BatchSolution",
    "FeasibleSet",
    "Instances",
    "LagrangianHessian",
    "Nlp",
    "Residuals",
    "Solution",
    "Status",
    "kkt_residuals",
    "nl_text",
    "operation_name",
    "read_nl",
    "relative_error",
]

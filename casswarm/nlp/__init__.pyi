from .nl_reader import read_nl
from .nl_writer import nl_text
from .program import FeasibleSet, Instances, LagrangianHessian, NamedRows, Nlp
from .residuals import invalid_value, kkt_residuals, relative_error
from .solution import BatchSolution, Residuals, Solution, Status

__all__ = [
    "BatchSolution",
    "FeasibleSet",
    "Instances",
    "LagrangianHessian",
    "NamedRows",
    "Nlp",
    "Residuals",
    "Solution",
    "Status",
    "invalid_value",
    "kkt_residuals",
    "nl_text",
    "read_nl",
    "relative_error",
]

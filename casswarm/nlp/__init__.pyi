from .nl_reader import read_nl
from .nl_writer import nl_bytes, nl_text
from .program import FeasibleSet, Instances, LagrangianHessian, NamedRows, Nlp
from .residuals import estimated_multipliers, invalid_value, kkt_residuals, relative_error
from .solution import BatchSolution, Residuals, Sensitivities, Solution, Status

__all__ = [
    "BatchSolution",
    "FeasibleSet",
    "Instances",
    "LagrangianHessian",
    "NamedRows",
    "Nlp",
    "Residuals",
    "Sensitivities",
    "Solution",
    "Status",
    "estimated_multipliers",
    "invalid_value",
    "kkt_residuals",
    "nl_bytes",
    "nl_text",
    "read_nl",
    "relative_error",
]

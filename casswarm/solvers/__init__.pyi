from .base import Answer, Capabilities, Solver
from .casadi_plugins import Alpaqa, Ipopt, NlpSol, Sleqp, Sqp, Uno
from .external import Pounce, Unopy
from .interior_point.solver import FilterInteriorPoint
from .isolated import Isolated
from .layers import layer
from .registry import SOLVERS, UNSUPPORTED, make_solver, register_solver
from .scipy import Minimize, Slsqp
from .sensitivity import sensitivities

def __getattr__(name: str) -> type[Solver]: ...  # registered by other rooms

__all__ = [
    "SOLVERS",
    "UNSUPPORTED",
    "Alpaqa",
    "Answer",
    "Capabilities",
    "FilterInteriorPoint",
    "Ipopt",
    "Isolated",
    "Minimize",
    "NlpSol",
    "Pounce",
    "Sleqp",
    "Slsqp",
    "Solver",
    "Sqp",
    "Uno",
    "Unopy",
    "layer",
    "make_solver",
    "register_solver",
    "sensitivities",
]

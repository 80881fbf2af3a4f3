from .alpaqa import Alpaqa
from .any_nlpsol import NlpSol
from .auto import Auto
from .base import Answer, Capabilities, Solver
from .batch.interior_point import InteriorPoint
from .batch.spg import SpectralProjectedGradient
from .interior_point.solver import FilterInteriorPoint
from .ipopt import Ipopt
from .isolated import Isolated
from .projected_gradient import ProjectedGradient
from .registry import SOLVERS, make_solver
from .scipy import Minimize, Slsqp
from .sleqp import Sleqp
from .sqp import Sqp
from .uno import Uno
from .unsupported import UNSUPPORTED

__all__ = [
    "SOLVERS",
    "UNSUPPORTED",
    "Alpaqa",
    "Answer",
    "Auto",
    "Capabilities",
    "FilterInteriorPoint",
    "InteriorPoint",
    "Ipopt",
    "Isolated",
    "Minimize",
    "NlpSol",
    "ProjectedGradient",
    "Sleqp",
    "Slsqp",
    "Solver",
    "SpectralProjectedGradient",
    "Sqp",
    "Uno",
    "make_solver",
]

from .alpaqa import Alpaqa
from .any_nlpsol import NlpSol
from .auto import Auto
from .base import Answer, Capabilities, Solver
from .batch.interior_point import InteriorPoint
from .batch.spg import SpectralProjectedGradient
from .interior_point.solver import FilterInteriorPoint
from .ipopt import Ipopt
from .isolated import Isolated
from .pounce import Pounce
from .projected_gradient import ProjectedGradient
from .registry import SOLVERS, make_solver
from .scipy import Minimize, Slsqp
from .sleqp import Sleqp
from .sqp import Sqp
from .uno import Uno
from .unopy import Unopy
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
    "Pounce",
    "ProjectedGradient",
    "Sleqp",
    "Slsqp",
    "Solver",
    "SpectralProjectedGradient",
    "Sqp",
    "Uno",
    "Unopy",
    "make_solver",
]

from .auto import Auto
from .horizon_method import InteriorPoint
from .leader_selection import LEADER_SELECTION
from .projected_gradient import ProjectedGradient
from .spectral import SpectralProjectedGradient
from .task import Formation, FormationTask

__all__ = [
    "LEADER_SELECTION",
    "Auto",
    "Formation",
    "FormationTask",
    "InteriorPoint",
    "ProjectedGradient",
    "SpectralProjectedGradient",
]

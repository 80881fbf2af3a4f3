from .auto import Auto
from .horizon import corridor_mpc_formation, leader_mpc_formation
from .horizon_method import InteriorPoint
from .objective import CompiledObjective, formation_program
from .projected_gradient import ProjectedGradient, SpectralProjectedGradient
from .state_kernels import decide_states
from .task import (
    LEADER_SELECTION,
    Formation,
    FormationTask,
    corridor_formation,
    leader_formation,
    or_none,
)

__all__ = [
    "LEADER_SELECTION",
    "Auto",
    "CompiledObjective",
    "Formation",
    "FormationTask",
    "InteriorPoint",
    "ProjectedGradient",
    "SpectralProjectedGradient",
    "corridor_formation",
    "corridor_mpc_formation",
    "decide_states",
    "formation_program",
    "leader_formation",
    "leader_mpc_formation",
    "or_none",
]

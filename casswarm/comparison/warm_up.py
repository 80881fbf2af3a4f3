"""What a solver's process does once, such as imports and compilation, before it is timed."""

from __future__ import annotations

import numpy as np

from ..hazard import Saturation
from ..optimization.solvers import Isolated
from ..problems.formation import Formation, corridor_formation
from ..problems.step import Motion, Step


def warm_up(solver: Isolated) -> None:
    """Let each process of a solver solve a small formation problem first, untimed, if it can."""
    formation = _two_members()
    solver.warm_up(formation.nlp, formation.instances)


def _two_members() -> Formation:
    """Two members in a corridor, which all kinds of solvers take: a product of planar sets."""
    step = Step(
        hazard=Saturation(((1.0, 1.0),)),
        motion=Motion(v_max=1.0, a_max=1.0, dt=1.0),
        positions=np.array([[[0.0, 0.0], [0.1, 0.0]]]),
        previous_velocities=np.zeros((1, 2, 2)),
        alive=np.ones((1, 2), bool),
        goals=np.array([[0.2, 0.1]]),
    )
    return corridor_formation(step, 0.1)

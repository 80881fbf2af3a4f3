"""The naive policy: every member follows a guide of its own and ignores the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Booleans, Floats
from ..guide import Guide
from ..problems.formation import SHORTFALL, Motion
from .base import Decision, Policy


@dataclass(frozen=True, eq=False)
class NaivePolicy(Policy):
    """Independent planning, the paper's baseline (section V.B, Figure 4).

    Parameters
    ----------
    motion : Motion
    guides : sequence of n Guide
        One for every member, from where it starts.
    """

    motion: Motion
    guides: Sequence[Guide]
    name: str = "naive"

    def decide(self, step: int, positions: Floats, previous: Floats, alive: Booleans) -> Decision:
        """Every member toward its own guide's next point, as near as the limits allow."""
        goals = np.stack([guide.reference(step + 1) for guide in self.guides])
        velocities = self.motion.toward(positions, previous, goals)
        missed = positions + self.motion.dt * velocities - goals
        short = alive & (np.hypot(missed[..., 0], missed[..., 1]) > SHORTFALL)
        none = np.zeros(len(velocities), np.int64)
        moving = np.where(alive[..., None], velocities, 0.0)
        return Decision(moving, short.sum(axis=1), none, none)

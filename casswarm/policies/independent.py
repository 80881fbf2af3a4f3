"""The naive policy: every member follows its own guide and ignores the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..planning.guide import Guide
from ..problems.formation import Motion
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy


@dataclass(frozen=True, eq=False)
class NaivePolicy(Policy):
    """Independent planning, the paper's baseline (section V.B, Figure 4).

    Parameters
    ----------
    motion : Motion
    guides : sequence of n Guide
        A guide for every member, from its initial position.
    """

    motion: Motion
    guides: Sequence[Guide]
    name: str = "naive"

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Move every member to its own guide's next point, as close as the limits allow.

        A member whose planning failed heads straight for the target, and counts as a failure.
        """
        goals = np.stack([g.reference(step + 1) if g.arrives else g.center for g in self.guides])
        unplanned = np.array([not guide.arrives for guide in self.guides])
        velocities = self.motion.toward(positions, previous_velocities, goals)
        infeasible = alive & ~unplanned & self.motion.misses(positions, velocities, goals)
        return Decision(
            np.where(alive[..., None], velocities, 0.0),
            infeasible.sum(axis=1),
            (alive & unplanned).any(axis=1).astype(np.int64),
            np.zeros(len(velocities), np.int64),
        )

"""Factors of the joint plan's Newton matrices, step by step: see `joint_riccati_kernels`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..optimization.solvers.interior_point.factors import shifts_to_try
from ..typing import FloatArray

if TYPE_CHECKING:
    from .joint_riccati_kernels import Stages


class StageFactors:
    """Factors of b matrices in the velocities of all steps: see `Factors`.

    Parameters
    ----------
    stages : Stages
        With the axis of instances in front of every array; slopes and bends (b,).
    last : (b,)
        Shifts that were last needed.
    """

    def __init__(self, stages: Stages, last: FloatArray) -> None:
        from .joint_riccati_kernels import Factor, factorise

        batch, steps, width = stages.limits.shape
        size = stages.terminal.shape[1] + 2 * width
        self._stages = stages
        self._factors = Factor(
            np.empty((batch, steps, width, width)), np.empty((batch, steps, width, size))
        )
        self.shifts = factorise(shifts_to_try(last), stages, self._factors)

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors`."""
        from .joint_substitution_kernels import solve

        solution = np.array(right.T, order="C").reshape(self._stages.limits.shape)
        solve(self._stages, self._factors, solution)
        return np.ascontiguousarray(solution.reshape(len(solution), -1).T)

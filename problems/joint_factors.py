"""Factors of the joint plan's Newton matrices, step by step: see `joint_riccati_kernels`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .._util.kernel_threads import execute
from ..typing import FloatArray

if TYPE_CHECKING:
    from .joint_riccati_kernels import Stages

_FACTORISED, _SOLVED = 2**12, 2**15  # sets, of all steps, that are worth a thread


class StageFactors:
    """Factors of b matrices in the velocities of all steps, for the interior-point method.

    Parameters
    ----------
    stages : Stages
        With the axis of instances in front of every array; slopes and bends (b,).
    shifts : (b, m)
        Shifts of the diagonals to try, in order.
    """

    def __init__(self, stages: Stages, shifts: FloatArray) -> None:
        from .joint_riccati_kernels import Factor, factorise

        batch, steps, width = stages.limits.shape
        size = stages.terminal.shape[1] + 2 * width
        self._stages = stages
        self._factors = Factor(
            np.empty((batch, steps, width, width)), np.empty((batch, steps, width, size))
        )
        self.shifts = np.empty(batch)
        arguments = shifts, stages, self._factors, self.shifts
        execute(factorise, batch, arguments, self._per_thread(_FACTORISED))

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors`."""
        from .joint_substitution_kernels import solve

        solution = np.array(right.T, order="C").reshape(self._stages.limits.shape)
        arguments = self._stages, self._factors, solution
        execute(solve, len(solution), arguments, self._per_thread(_SOLVED))
        return np.ascontiguousarray(solution.reshape(len(solution), -1).T)

    def _per_thread(self, sets: int) -> int:
        """Matrices that are worth a thread, where so many sets of all steps are."""
        return sets // math.prod(self._stages.by_set.shape[1:3])

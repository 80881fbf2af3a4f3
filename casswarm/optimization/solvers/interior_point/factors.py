"""Factors of the condensed matrices of many instances: dense ones, by LAPACK."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.linalg import lapack

from ....typing import FloatArray

_SHIFTS = 40  # attempts to make a matrix positive definite


class Factors(Protocol):
    """Cholesky factors of b matrices, to each of whose diagonals a shift was added."""

    shifts: FloatArray
    """(b,), NaN where none was enough."""

    def solve(self, right: FloatArray) -> FloatArray:
        """Solutions (n, b) of the systems with these right-hand sides."""


class DenseFactors:
    """Factors of matrices (b, n, n), of which the lower triangles are read.

    `shifts` (b, m) are tried in order.
    """

    def __init__(self, matrices: FloatArray, shifts: FloatArray) -> None:
        diagonal = np.arange(matrices.shape[1])
        self._factors: list[FloatArray] = []
        self.shifts = np.full(len(matrices), np.nan)
        for row, (matrix, tried) in enumerate(zip(matrices, shifts, strict=True)):
            factor = matrix
            for shift in tried:
                shifted = matrix.copy()
                shifted[diagonal, diagonal] += shift
                factor, info = lapack.dpotrf(shifted.T, lower=0, overwrite_a=1)
                if info == 0:
                    self.shifts[row] = shift
                    break
            self._factors.append(factor)

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors`."""
        solutions = np.empty_like(right)
        for row, factor in enumerate(self._factors):
            solutions[:, row] = lapack.dpotrs(factor, right[:, row], lower=0)[0]
        return solutions


def shifts_to_try(last: FloatArray) -> FloatArray:
    """Shifts (b, m) of diagonals, none first, from the last ones (b,) that were needed."""
    known = last > 0.0
    first = np.where(known, np.maximum(1e-20, last / 3.0), 1e-4)
    factor = np.where(known, 8.0, 100.0)
    shifts = first[:, None] * factor[:, None] ** np.arange(_SHIFTS)
    return np.hstack([np.zeros((len(last), 1)), shifts])

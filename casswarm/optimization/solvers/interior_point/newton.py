"""Newton's equations of the interior-point method, condensed to the variables.

With ds = J dx + g - s and the bounds' weights sigma = z_l / (y - l) + z_u / (u - y) eliminated, the
matrix of dx is the Lagrangian's Hessian + diag(sigma_x) + J' diag(sigma_s) J. Where it is not
positive definite, a multiple of the identity is added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from ....typing import BoolArray, FloatArray
from .problems import Linearisation

_SHIFTS = 40  # attempts to make a matrix positive definite


@dataclass(eq=False)
class CondensedSystems:
    """The condensed equations of b instances, factorised.

    Parameters
    ----------
    at : Linearisation
    weights : (b, k)
        Weights of the bounds of x and s.
    gradient : (b, k)
        Gradients of the barrier function plus lam' (g - s), zero where y is fixed.
    fixed : (b, k) bool
    """

    at: Linearisation
    weights: FloatArray
    gradient: FloatArray
    fixed: BoolArray

    def factorise(self, multipliers: FloatArray, last: FloatArray) -> FloatArray:
        """Factorise; return the shifts (b,) of the diagonals, NaN where none is enough.

        `last` are the shifts of the previous iteration that needed one.
        """
        size = self.at.gradient.shape[1]
        matrices = self.at.condensed(multipliers, self.weights[:, size:])
        diagonal = np.arange(size)
        matrices[:, diagonal, diagonal] += self.weights[:, :size]
        self._factors: list[FloatArray] = []
        shifts = np.full(len(matrices), np.nan)
        for row, matrix in enumerate(matrices):
            factor = matrix
            for shift in _shifts(float(last[row])):
                shifted = matrix.copy()
                shifted[diagonal, diagonal] += shift
                factor, info = lapack.dpotrf(shifted.T, lower=0, overwrite_a=1)
                if info == 0:
                    shifts[row] = shift
                    break
            self._factors.append(factor)
        return shifts

    def direction(self, primal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Steps of y and lam that reduce g - s by `primal` (b, ng) to first order."""
        size = self.at.gradient.shape[1]
        weights, free = self.weights[:, size:], ~self.fixed
        pull = weights * primal + self.gradient[:, size:]
        right = self.gradient[:, :size] + self.at.transposed_times(pull)
        right = np.where(free[:, :size], -right, 0.0)
        dx = np.empty_like(right)
        for row, factor in enumerate(self._factors):
            dx[row] = lapack.dpotrs(factor, right[row], lower=0)[0]
        dx = np.where(free[:, :size], dx, 0.0)
        ds = self.at.times(dx) + primal
        multipliers = weights * ds + self.gradient[:, size:]
        return np.hstack([dx, np.where(free[:, size:], ds, 0.0)]), multipliers


def _shifts(last: float) -> FloatArray:
    """Shifts of a diagonal to try, from the last that was needed."""
    first, factor = (max(1e-20, last / 3.0), 8.0) if last > 0.0 else (1e-4, 100.0)
    return np.concatenate([[0.0], first * factor ** np.arange(_SHIFTS)])

"""Newton's equations of the interior-point method, condensed to the variables.

With ds = J dx + g - s and the bounds' weights sigma = z_l / (y - l) + z_u / (u - y) eliminated, the
matrix of dx is the Lagrangian's Hessian + diag(sigma_x) + J' diag(sigma_s) J. Where it is not
positive definite, a multiple of the identity is added.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ....typing import BoolArray, FloatArray
from .factors import DenseFactors, Factors
from .problems import Factorises, Linearisation


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
    _factors: Factors = field(init=False)

    def factorise(self, multipliers: FloatArray, last: FloatArray) -> FloatArray:
        """Factorise; return the shifts (b,) of the diagonals, NaN where none is enough.

        `last` are the shifts of the previous iteration that needed one.
        """
        if isinstance(self.at, Factorises):
            self._factors = self.at.factors(multipliers, self.weights, last)
        else:
            size = self.at.gradient.shape[1]
            matrices = self.at.condensed(multipliers, self.weights[:, size:])
            diagonal = np.arange(size)
            matrices[:, diagonal, diagonal] += self.weights[:, :size]
            self._factors = DenseFactors(matrices, last)
        return self._factors.shifts

    def direction(self, primal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Steps of y and lam that reduce g - s by `primal` (b, ng) to first order."""
        size = self.at.gradient.shape[1]
        weights, free = self.weights[:, size:], ~self.fixed
        pull = weights * primal + self.gradient[:, size:]
        right = self.gradient[:, :size] + self.at.transposed_times(pull)
        right = np.where(free[:, :size], -right, 0.0)
        dx = np.where(free[:, :size], self._factors.solve(right), 0.0)
        ds = self.at.times(dx) + primal
        multipliers = weights * ds + self.gradient[:, size:]
        return np.hstack([dx, np.where(free[:, size:], ds, 0.0)]), multipliers

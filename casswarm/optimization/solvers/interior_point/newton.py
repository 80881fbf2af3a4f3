"""Newton's equations of the interior-point method, condensed to the variables.

With ds = J dx + g - s and the bounds' weights sigma = z_l / (y - l) + z_u / (u - y) eliminated, the
matrix of dx is the Lagrangian's Hessian + diag(sigma_x) + J' diag(sigma_s) J. Where it is not
positive definite, a multiple of the identity is added.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ....typing import BoolArray, FloatArray
from .factors import Factors
from .iterates import Iterates
from .lane_kernels import EQUALITY, FIXED
from .problems import Linearisation, Problems


@dataclass(eq=False)
class CondensedSystems:
    """The condensed equations of b instances, factorised.

    Parameters
    ----------
    at : Linearisation
    weights : (k, b)
        Weights of the bounds of x and s.
    gradient : (k, b)
        Gradients of the barrier function plus lam' (g - s), zero where y is fixed.
    fixed : (k, b) bool
    """

    at: Linearisation
    weights: FloatArray
    gradient: FloatArray
    fixed: BoolArray
    _factors: Factors = field(init=False)

    def factorise(
        self, multipliers: FloatArray, last: FloatArray, objective: float = 1.0
    ) -> FloatArray:
        """Factorise; return the shifts (b,) of the diagonals, NaN where none is enough.

        `last` are the shifts of the previous iteration that needed one; `objective` is the weight
        of f in the Hessian.
        """
        self._factors = self.at.factors(multipliers, self.weights, last, objective)
        return self._factors.shifts

    def direction(self, primal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Steps of y and lam that reduce g - s by `primal` (ng, b) to first order."""
        from .step_kernels import condense, expand, right_hand_sides

        pull, right = np.empty_like(primal), np.empty_like(self.at.gradient)
        condense(self.weights, self.gradient, primal, pull)
        pulled = self.at.transposed_times(pull)
        right_hand_sides(self.gradient, pulled, self.fixed, right)
        dx = self._factors.solve(right)
        step, multipliers = np.empty_like(self.gradient), np.empty_like(primal)
        equations = self.weights, self.gradient, primal, self.fixed
        expand((dx, self.at.times(dx)), equations, step, multipliers)
        return step, multipliers


def estimate_multipliers(problems: Problems, iterates: Iterates, largest: float) -> None:
    """Let lam minimise the sum of squares of the Lagrangian's gradient, where it is not too large.

    Elsewhere it stays as it is, as in Ipopt (``constr_mult_init_max``).
    """
    if largest == 0.0 or not iterates.lam.size:
        return
    size, bounds = iterates.size, iterates.bounds
    at = problems.linearise(iterates.rows, iterates.y[:size])
    gradient = iterates.z[1] - iterates.z[0]
    gradient[:size] += at.gradient
    weights = np.ones_like(gradient)
    weights[size:][bounds.fixed[size:]] = EQUALITY
    weights[:size][bounds.fixed[:size]] = FIXED
    systems = CondensedSystems(at, weights, np.where(bounds.fixed, 0.0, gradient), bounds.fixed)
    none = np.zeros_like(iterates.lam)
    systems.factorise(none, np.zeros(iterates.mu.size), 0.0)
    _, lam = systems.direction(none)
    iterates.lam = np.where(abs(lam).max(axis=0) <= largest, lam, iterates.lam)

"""Instances of the joint plan as numbers, with derivatives from compiled steps.

The program of `casswarm.problems.joint`, for rates that are made of kernels. In the positions all
but the recursion is local to a step, and so are limits of acceleration in the velocities; sums over
later steps lead from one to the other. Second derivatives between steps are not formed: Newton's
equations are solved step by step (`joint_riccati_kernels`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..hazard import KernelHazard
from ..optimization.problem import Nlp
from ..typing import FloatArray, IntArray
from .joint_constraints import Constraints, backward_sums
from .joint_factors import StageFactors
from .joint_rates import LocalRates, set_rates

if TYPE_CHECKING:
    from .joint_derivative_kernels import Derivatives

TINY, CERTAIN = 1e-30, 1e-13
"""Offsets that keep the log-odds finite at a cost of 0 and of 1."""


@dataclass(frozen=True, eq=False)
class JointNumeric:
    """B instances of a joint plan: see `NumericProblems`.

    Parameters
    ----------
    nlp : Nlp
    hazard : KernelHazard
    n : int
    p : (B, np)
    """

    nlp: Nlp
    hazard: KernelHazard
    n: int
    p: FloatArray

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `NumericProblems`."""
        points = self._points(rows, x)
        return log_odds(points.failure), points.constraints.values

    def linearise(self, rows: IntArray, x: FloatArray) -> JointLinearisation:
        """See `NumericProblems`."""
        return JointLinearisation(self._points(rows, x))

    def _points(self, rows: IntArray, x: FloatArray) -> JointPoints:
        p = {name: blocks[rows] for name, blocks in self._parameters.items()}
        velocities = x.reshape(len(x), -1, self.n, 2)
        constraints = Constraints.at(tuple(self.nlp.constraints), velocities, p)
        return JointPoints(self.hazard, constraints, p)

    @cached_property
    def _parameters(self) -> dict[str, FloatArray]:
        return self.nlp.parameter_blocks(self.p)


def log_odds(failure: FloatArray) -> FloatArray:
    """The objective of probabilities F."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.log(failure + TINY) - np.log(1.0 - failure + CERTAIN))


@dataclass(frozen=True, eq=False)
class JointPoints:
    """Points of b instances.

    Parameters
    ----------
    hazard : KernelHazard
    constraints : Constraints
    p : dict of name to array
        Parameters of every instance.
    """

    hazard: KernelHazard
    constraints: Constraints
    p: dict[str, FloatArray]

    @property
    def failure(self) -> FloatArray:
        """F of every instance, (b,)."""
        if "_rates" in vars(self):
            return self._chances[1][:, -1]
        return self._swept(set_rates(self.hazard, self._swarms))[1][:, -1]

    @cached_property
    def _positions(self) -> FloatArray:
        """X(1..T), (b, T, n, 2)."""
        p = {name: self.p[name][:, None] for name in ("origin", "length", "center")}
        return np.asarray(p["origin"] + p["length"] * (self.constraints.to_center + p["center"]))

    @property
    def _swarms(self) -> FloatArray:
        """The positions, with instances and steps on one axis."""
        return self._positions.reshape(-1, *self._positions.shape[2:])

    @cached_property
    def _rates(self) -> LocalRates:
        return LocalRates.of(self.hazard, self._swarms)

    @cached_property
    def _chances(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return self._swept(self._rates.rates[..., 0])

    def _swept(self, rates: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Probabilities of losses (b, T, m, n), F_0 (b, m), masses and functions (b, T, m)."""
        from .joint_kernels import sweep

        by_step = rates.reshape(*self._positions.shape[:2], *rates.shape[1:])
        lost = -np.expm1(-self.p["clock"][..., None] * by_step)
        ends = self.p["continues"], self.p["costs"], self.p["last_cost"][:, 0]
        return lost, *sweep(lost, *ends)

    def differentiated(self) -> Derivatives:
        """Derivatives of F in all steps, in lengths of a step at v_max: see `Derivatives`."""
        from .joint_derivative_kernels import Derivatives, Step, differentiate_steps

        lost, _, masses, after = self._chances
        batch, steps, sets, n = lost.shape
        width = 2 * n
        shapes = (width,), (width, width), (sets, width), (sets, width), (3**n,)
        out = Derivatives(*(np.zeros((batch, steps, *shape)) for shape in shapes))
        local = self._rates
        radars, pairs, rates = (
            part.reshape(batch, steps, *part.shape[1:])
            for part in (local.radars, local.pairs, local.rates)
        )
        points = self._positions.reshape(batch, steps, width)
        clocks, collides = self.p["clock"][:, 0, 0], self.hazard.collides
        continues, costs = self.p["continues"].copy(), self.p["costs"].copy()
        continues[..., 0], costs[..., 0] = 0.0, self.p["last_cost"][..., 0]
        data = Step(
            points, 0.0, lost, masses, after, radars, pairs, rates, collides, continues, costs
        )
        differentiate_steps(clocks, data, out)
        unit = self.p["length"]
        gradient, by_set, by_outcome = (
            part * unit.reshape(-1, *(1,) * (part.ndim - 1))
            for part in (out.gradient, out.by_set, out.by_outcome)
        )
        hessian = unit[..., None] ** 2 * out.hessian
        return Derivatives(gradient, hessian, by_set, by_outcome, out.transitions)


class JointLinearisation:
    """Derivatives of b instances at a point each: see `RowLinearisation`."""

    def __init__(self, points: JointPoints) -> None:
        self._constraints = points.constraints
        self._steps, self._last_cost = points.differentiated(), points.p["last_cost"][:, 0]
        failure = points.failure
        below, above = 1.0 / (failure + TINY), 1.0 / (1.0 - failure + CERTAIN)
        self._slope, self._bend = below + above, above**2 - below**2  # of the log-odds
        by_velocity = backward_sums(self._steps.gradient.copy(), 1)
        self.gradient = self._slope[:, None] * by_velocity.reshape(len(failure), -1)

    def times(self, vectors: FloatArray) -> FloatArray:
        """See `RowLinearisation`."""
        return self._constraints.times(vectors.reshape(self._constraints.changes.shape))

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """See `RowLinearisation`."""
        return self._constraints.transposed_times(vectors).reshape(len(vectors), -1)

    def factors(
        self, multipliers: FloatArray, weights: FloatArray, last: FloatArray, objective: float = 1.0
    ) -> StageFactors:
        """See `RowLinearisation`."""
        from .joint_riccati_kernels import Stages

        steps, size = self._steps, self.gradient.shape[1]
        positions, changes = self._constraints.curvature(multipliers, weights[:, size:])
        slope, terminal = objective * self._slope, self._last_cost.copy()
        terminal[:, 0] = 1.0
        positions += slope[:, None, None, None] * steps.hessian
        limits = np.ascontiguousarray(weights[:, :size]).reshape(steps.gradient.shape)
        of_law = steps.transitions, steps.by_outcome, steps.by_set
        of_objective = slope, objective * self._bend
        stages = Stages(*of_law, positions, changes, limits, terminal, *of_objective)
        return StageFactors(stages, last)

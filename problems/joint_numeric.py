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

from .._util.kernel_threads import execute
from ..hazard import KernelHazard
from ..optimization.problem import Nlp
from ..typing import FloatArray, IntArray
from .joint_constraints import Constraints, backward_sums
from .joint_factors import StageFactors
from .joint_rates import LocalRates, blocked, set_rates, unblocked

if TYPE_CHECKING:
    from .joint_derivative_kernels import Derivatives

TINY, CERTAIN = 1e-30, 1e-13
"""Offsets that keep the log-odds finite at a cost of 0 and of 1."""

_PER_THREAD = 2**7  # sets, of blocks of steps, that are worth a thread


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
        return self._swept(set_rates(self.hazard, self._blocks))[1][:, -1]

    @cached_property
    def _blocks(self) -> FloatArray:
        """X(1..T), the steps of all instances in blocks (k, n, 2, LANES)."""
        p = {name: self.p[name][:, None] for name in ("origin", "length", "center")}
        points = p["origin"] + p["length"] * (self.constraints.to_center + p["center"])
        return blocked(points.reshape(-1, *points.shape[2:]))

    @cached_property
    def _rates(self) -> LocalRates:
        return LocalRates.of(self.hazard, self._blocks)

    @cached_property
    def _chances(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return self._swept(self._rates.rates[:, :, 0])

    def _swept(self, rates: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Probabilities of losses in blocks, F_0 (b, m), masses and functions (b, T, m)."""
        from .joint_kernels import recursion

        lost = -np.expm1(-self._clock[:, None, None] * rates)
        batch, steps = self.constraints.changes.shape[:2]
        by_step = unblocked(lost, batch * steps)
        ends = self.p["continues"], self.p["costs"], self.p["last_cost"][:, 0]
        return lost, *recursion(by_step.reshape(batch, steps, *by_step.shape[1:]), *ends)

    @property
    def _clock(self) -> FloatArray:
        """The time step of all steps in blocks, (k, LANES)."""
        shape = self.constraints.changes.shape[:2]
        return self._in_blocks(np.broadcast_to(self.p["clock"][:, :, 0], shape))

    def _in_blocks(self, values: FloatArray) -> FloatArray:
        """Values (b, T, ...) of all steps in blocks (k, ..., LANES)."""
        return blocked(values.reshape(-1, *values.shape[2:]))

    def differentiated(self) -> Derivatives:
        """Derivatives of F in all steps, in lengths of a step at v_max: see `Derivatives`."""
        from .joint_derivative_kernels import Derivatives, Steps, differentiate

        lost, _, masses, after = self._chances
        (batch, steps, sets), n = masses.shape, lost.shape[2]
        width, local = 2 * n, self._rates
        shapes = (width,), (width, width), (sets, width), (sets, width), (3**n,)
        flat = Derivatives(*(np.empty((batch * steps, *shape)) for shape in shapes))
        continues, costs = self.p["continues"].copy(), self.p["costs"].copy()
        continues[..., 0], costs[..., 0] = 0.0, self.p["last_cost"][..., 0]
        of_sets = [self._in_blocks(part) for part in (masses, after, continues, costs)]
        arrays = lost, *of_sets, self._blocks, local.radars, local.pairs, local.rates
        in_steps = Steps._make([self._clock, *arrays])
        arguments = in_steps, self.hazard.collides, flat
        execute(differentiate, len(lost), arguments, _PER_THREAD // sets)
        out = Derivatives(*(part.reshape(batch, steps, *part.shape[1:]) for part in flat))
        unit = self.p["length"]
        out.gradient[:] *= unit
        out.by_set[:] *= unit[..., None]
        out.by_outcome[:] *= unit[..., None]
        out.hessian[:] *= unit[..., None] ** 2
        return out


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
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        shifts: FloatArray,
        objective: float = 1.0,
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
        return StageFactors(stages, shifts)

"""A compiled primal-dual interior-point method for trajectories within limits, over batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from ..compiled.kernels import contiguous
from ..compiled.parallel import execute
from ..errors import SolverError
from ..nlp.program import Instances, Nlp
from ..solvers.base import Allowed, Capabilities, PositiveFinite, PositiveInt
from ..typing import FloatArray
from .objective import CompiledObjective, start_count
from .projected_gradient import BatchRun, BatchSolver
from .spectral_kernels import Results
from .trajectory import TrajectorySets

if TYPE_CHECKING:
    from .spectral_kernels import Starts

_SPREAD = 1.0  # standard deviation of starts, in largest changes of velocity
_PER_THREAD = 32  # instances that are worth a thread


@dataclass(frozen=True)
class InteriorPoint(BatchSolver):
    """Feasible primal-dual interior point with exact limits, state by state.

    For problems over trajectories (`TrajectorySets`) with a `CompiledObjective` attached.

    Parameters
    ----------
    tolerance : float
        Largest component of the Lagrangian's gradient at the end, in `Instances.scale`.
    mu_final : float
        Barrier parameter at the end, in units of the objective: every multiplier times its slack.
    max_iter : int
        Limit for every start.
    n_starts : int, optional
        Starts of every instance, as for `SpectralProjectedGradient`. By default as many as the
        problem says are worth it (`StartCount`).
    """

    tolerance: PositiveFinite = 1e-8
    mu_final: Annotated[float, Allowed(lambda value: 0 < value < 1, "between 0 and 1")] = 1e-12
    max_iter: PositiveInt = 200
    n_starts: PositiveInt | None = None

    name: ClassVar[str] = "horizon"
    summary: ClassVar[str] = "compiled interior point over batches; MPC formations only"
    capabilities: ClassVar[Capabilities] = Capabilities("paths", batch=True, multipliers=True)

    @staticmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Return True if the objective is compiled, and the feasible set one of trajectories."""
        sets = instances.feasible_set
        if not isinstance(sets, TrajectorySets) or nlp.attached(CompiledObjective) is None:
            return False
        return bool((instances.scale[:, 0] == sets.limits.speed).all())  # the kernels' unit

    def run_batch(self, nlp: Nlp, instances: Instances) -> InteriorPointRun:
        """Solve and verify every instance.

        Stationarity is the larger of the Lagrangian's gradient and of complementarity, in
        `Instances.scale`.
        """
        if not self.can_take(nlp, instances):
            raise SolverError(
                f"horizon cannot take {nlp.name}: it needs paths within limits of speed and "
                "acceleration, and an objective made of kernels; take auto or ipopt",
                solver="horizon",
                problem=nlp.name,
            )
        instances.require_fit(nlp)
        # Numba takes a second to import
        from .horizon_kernels import Batch, Options, minimise_batch
        from .spectral_kernels import Starts

        sets = instances.feasible_set
        assert isinstance(sets, TrajectorySets)
        compiled = nlp.attached(CompiledObjective)
        assert compiled is not None
        batch, steps, n = sets.shape
        data = Batch(
            x0=contiguous(instances.x0.reshape(batch, steps, 2 * n)),
            inside=contiguous(sets.inside.reshape(batch, steps, 2 * n)),
            free=contiguous(sets.free),
            initial_velocities=contiguous(sets.initial_velocities.reshape(batch, 1, 2 * n)),
            change=sets.limits.change,
            centers=contiguous(sets.centers.swapaxes(1, 2).reshape(batch, steps, 2 * n)),
            radii=contiguous(sets.radii.swapaxes(1, 2)),
            p=contiguous(instances.p)[:, None],
            constants=np.atleast_2d(compiled.constants),
            scale=contiguous(instances.scale),
        )
        number = self.n_starts or start_count(nlp)
        starts = Starts.single() if number == 1 else _starts(number, sets, data.x0)
        options = Options(self.mu_final, self.tolerance, self.max_iter)
        multipliers = np.zeros((batch, steps, n, 6))
        results = Results.empty((batch, steps, 2 * n))
        arguments = compiled.evaluate, data, starts, options, multipliers, results
        seconds = execute(minimise_batch, batch, arguments, _PER_THREAD)
        results.verified[:, 1] *= data.scale[:, 0]
        results = results._replace(x=results.x.reshape(instances.x0.shape))
        return InteriorPointRun(results, seconds, instances, nlp, multipliers)


def _starts(number: int, sets: TrajectorySets, x0: FloatArray) -> Starts:
    """Starts around guesses (B, H, 2n)."""
    from .spectral_kernels import Starts

    spread = np.where(sets.free, _SPREAD * sets.limits.change, 0.0)
    guesses = x0.sum(axis=1).reshape(*spread.shape, 2)
    return Starts.around(number, spread, guesses, sets.centers.sum(axis=2))


@dataclass(frozen=True, eq=False)
class InteriorPointRun(BatchRun):
    """The answers of one batch, with the multipliers of the slacks, (B, H, n, 6), in units."""

    nlp: Nlp
    slack_multipliers: FloatArray

    def multipliers(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Multipliers of the bounds and of g, from those of the slacks."""
        sets, x, p = self.instances.feasible_set, self.results.x[i], self.instances.p[i]
        assert isinstance(sets, TrajectorySets)
        z, (_, steps, n) = self.slack_multipliers[i], sets.shape
        speed, value = self.instances.scale[i]
        box = (z[..., :2] - z[..., 2:4]) * value
        # constraints are in units of x
        rows = {"acceleration": value * z[..., 4], "speed": box[1:], "corridor": value * z[..., 5]}
        lam_g = np.concatenate([rows[name].ravel() for name in self.nlp.constraints])
        gradient = np.asarray(self.nlp.gradient(x, p)[1]).ravel()
        lagrangian = gradient + np.asarray(self.nlp.jacobian(x, p)).T @ lam_g
        lam_x = np.zeros((steps, n, 2))
        lam_x[0] = box[0] / speed
        free = sets.free[i][None, :, None]
        return np.where(free, lam_x, -lagrangian.reshape(steps, n, 2)).ravel(), lam_g

"""A compiled primal-dual barrier method for paths within limits, over batches."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Annotated, ClassVar

import numpy as np

from ...._util.jit import compiled_module
from ....errors import SolverError
from ....typing import BoolArray, FloatArray, IntArray
from ...feasible_sets.trajectory import PathSets, interior_point_sources
from ...problem import Instances, Nlp
from ...solution import BatchSolution, Status
from ..base import VIOLATION, Answer, Capabilities, Solver
from ..options import Allowed, PositiveFinite, PositiveInt
from . import interior_point_kernels
from .spg import in_threads

_WORDS = {
    interior_point_kernels.CONVERGED: (Status.SOLVED, "stationary to tolerance"),
    interior_point_kernels.EXHAUSTED: (Status.ITERATION_LIMIT, "iterations exhausted"),
    interior_point_kernels.STALLED: (Status.FAILED, "no decrease along the Newton step"),
    interior_point_kernels.NOT_FINITE: (Status.FAILED, "objective or step not finite"),
    interior_point_kernels.NO_INSIDE: (Status.FAILED, "no point strictly within the limits"),
}
_SPREAD = 1.0  # of further starts, in largest changes of velocity
_SHARE = 32  # instances that are worth a thread


@dataclass(frozen=True)
class InteriorPoint(Solver):
    """Feasible primal-dual interior point with exact limits, state by state (`barrier_core`).

    For problems over paths (`Instances.feasible_set`) whose objective is there as source.

    Parameters
    ----------
    tolerance : float
        Largest component of the Lagrangian's gradient at the end, in `Instances.scale`.
    finest : float
        Barrier parameter at the end, in units of the objective: every multiplier times its slack.
    max_iter : int
        Limit for every start.
    n_starts : int, optional
        Starts of every instance: the given one and others around it, in the same pattern for every
        state. By default as many as the problem says are worth it (`Nlp.n_starts`).
    """

    tolerance: PositiveFinite = 1e-8
    finest: Annotated[float, Allowed(lambda value: 0 < value < 1, "between 0 and 1")] = 1e-12
    max_iter: PositiveInt = 200
    n_starts: PositiveInt | None = None

    name: ClassVar[str] = "barrier"
    summary: ClassVar[str] = "compiled interior point over batches; look-ahead problems only"
    capabilities: ClassVar[Capabilities] = Capabilities("paths", batch=True, multipliers=True)

    @staticmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Whether the constraints are limits of paths, and the objective is there as source."""
        return isinstance(instances.feasible_set, PathSets) and nlp.compiled is not None

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        if nlp.compiled is not None:
            _module(nlp)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return self.run_batch(nlp, instances).answers()

    def run_batch(self, nlp: Nlp, instances: Instances) -> InteriorPointRun:
        """Solve and judge every instance; what it took stays in the `InteriorPointRun`."""
        if not self.can_take(nlp, instances):
            raise SolverError(
                f"barrier cannot take {nlp.name}: it needs paths within limits of speed and "
                "acceleration, and an objective made of kernels; take auto or ipopt"
            )
        return InteriorPointRun.of(self, nlp, instances)

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; every answer is judged, by the problem alone, as it is found.

        Stationarity is the larger of the Lagrangian's gradient and of complementarity, in
        `Instances.scale`.
        """
        run = self.run_batch(nlp, instances)
        return run.solution(run.outcome == interior_point_kernels.CONVERGED)


@dataclass(frozen=True, eq=False)
class InteriorPointRun:
    """The answers of one batch; see `interior_point_kernels.minimise_batch`."""

    nlp: Nlp
    paths: PathSets
    parameters: FloatArray
    units: FloatArray
    x: FloatArray
    multipliers: FloatArray
    judged: FloatArray
    outcome: IntArray
    counts: IntArray
    seconds: float

    @classmethod
    def of(cls, solver: InteriorPoint, nlp: Nlp, instances: Instances) -> InteriorPointRun:
        """Solve; each state alone, on any thread."""
        started = time.perf_counter()
        paths, units = instances.feasible_set, instances.scale
        assert isinstance(paths, PathSets)
        assert nlp.compiled is not None
        batch, steps, n = paths.shape
        units = np.ones((batch, 2)) if units is None else np.ascontiguousarray(units)
        given = (
            _starts(instances, paths, solver.n_starts or nlp.n_starts),
            np.ascontiguousarray(paths.inside).reshape(batch, steps, 2 * n),
            np.ascontiguousarray(paths.free),
            np.ascontiguousarray(paths.before),
            np.array([paths.speed, paths.change]),
            np.ascontiguousarray(paths.centers),
            np.ascontiguousarray(paths.radii),
            np.ascontiguousarray(instances.p)[:, None],
            nlp.compiled.shared,
            units,
            solver.finest,
            solver.tolerance,
            solver.max_iter,
        )
        x, multipliers = np.empty((batch, steps, 2 * n)), np.zeros((batch, steps, n, 6))
        judged, outcome = np.empty((batch, 3)), np.empty(batch, np.int64)
        counts = np.zeros((batch, 2), np.int64)
        results = (x, multipliers, judged, outcome, counts)
        minimise = _module(nlp).minimise_batch
        in_threads(lambda first, last: minimise(first, last, *given, *results), batch, _SHARE)
        return cls(
            nlp=nlp,
            paths=paths,
            parameters=instances.p,
            units=units,
            x=x.reshape(batch, -1),
            multipliers=multipliers,
            judged=judged,
            outcome=outcome,
            counts=counts,
            seconds=time.perf_counter() - started,
        )

    def solution(self, success: BoolArray) -> BatchSolution:
        """The answers as arrays; none is a success that violates its constraints."""
        objective, violation, residual = self.judged.T
        return BatchSolution(
            x=self.x,
            objective=objective,
            success=success & (self.units[:, 0] * violation <= VIOLATION),
            violation=self.units[:, 0] * violation,
            stationarity=residual,
            used_fallback=np.zeros(len(self.x), bool),
            seconds=self.seconds,
        )

    def answers(self) -> list[Answer]:
        """The answers one by one."""
        return [
            Answer(
                self.x[i],
                *_WORDS[int(self.outcome[i])],
                iterations=int(self.counts[i, 0]),
                evaluations=int(self.counts[i, 1]),
                seconds=self.seconds / len(self.x),
                multipliers=self._multipliers(i),
            )
            for i in range(len(self.x))
        ]

    def _multipliers(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Those of the bounds and of g, from those of the slacks in units."""
        z, (_, steps, n) = self.multipliers[i], self.paths.shape
        speed, value = self.units[i]
        box = (z[..., :2] - z[..., 2:4]) * value / speed
        rows = {
            "acceleration": z[..., 4] * value / speed**2,
            "speed": box[1:],
            # of squared distances, advances are velocities times dt
            "corridor": z[..., 5] * value / (speed * self._dt(i)) ** 2,
        }
        lam_g = np.concatenate([rows[name].ravel() for name in self.nlp.constraints])
        gradient = np.asarray(self.nlp.gradient(self.x[i], self.parameters[i])[1]).ravel()
        pulled = gradient + np.asarray(self.nlp.jacobian(self.x[i], self.parameters[i])).T @ lam_g
        lam_x = np.zeros((steps, n, 2))
        lam_x[0] = box[0]
        free = self.paths.free[i][None, :, None]
        return np.where(free, lam_x, -pulled.reshape(steps, n, 2)).ravel(), lam_g

    def _dt(self, i: int) -> float:
        place = 0
        for name, symbol in self.nlp.parameters.items():
            if name == "dt":
                return float(self.parameters[i, place])
            place += symbol.numel()
        return 1.0


def _starts(instances: Instances, paths: PathSets, number: int) -> FloatArray:
    """Starts (B, S, H, 2n): the given one, or several around it, the same way for every state."""
    batch, steps, n = paths.shape
    starts = np.repeat(instances.x0.reshape(batch, 1, steps, n, 2), number, axis=1)
    if number > 1:
        # one pattern for all states, so that a state's answer does not depend on its batch
        pattern = np.random.default_rng(1).normal(size=(number, 1, n, 2))
        starts += _SPREAD * paths.change * pattern
    return starts.reshape(batch, number, steps, 2 * n)


def _module(nlp: Nlp) -> ModuleType:
    assert nlp.compiled is not None
    return compiled_module(nlp.compiled.source, *interior_point_sources())

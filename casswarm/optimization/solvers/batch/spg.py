"""The nonmonotone spectral projected gradient, compiled, over batches."""

from __future__ import annotations

import inspect
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import ClassVar

import numpy as np

from ...._util.jit import compiled_module
from ....errors import SolverError
from ....typing import BoolArray, FloatArray, IntArray
from ...feasible_sets import planar_kernels
from ...feasible_sets.planar import PlanarSets
from ...problem import Instances, Nlp
from ...solution import BatchSolution, Status
from ..base import VIOLATION, Answer, Capabilities, Solver
from ..options import PositiveFinite, PositiveInt
from . import face_newton_kernels, spg_kernels, spg_numpy

_WORDS = {
    spg_kernels.CONVERGED: (Status.SOLVED, "stationary to tolerance"),
    spg_kernels.EXHAUSTED: (Status.ITERATION_LIMIT, "iterations exhausted"),
    spg_kernels.STALLED: (Status.FAILED, "no decrease along the projected gradient"),
    spg_kernels.NOT_FINITE: (Status.FAILED, "objective or gradient not finite"),
}
_SHARE = 256  # instances that are worth a thread
_SPREAD = 2.0  # of further starts, in radii of the smallest disc


@dataclass(frozen=True)
class SpectralProjectedGradient(Solver):
    """SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000), state by state.

    For problems on products of boxes and discs. Where the objective is there as source
    (`Nlp.compiled`), the loop is compiled once for every kind of objective and kept on disk, and
    Newton steps on the face that was found speed up its end; any other objective is evaluated by
    CasADi, for all states together, which is slower (`spectral_mapped`).

    Parameters
    ----------
    tolerance : float
        A point x has converged when no component of x - P(x - grad f(x)) is larger, all in
        `Instances.scale`: an answer does not depend on the scenario's units.
    max_iter : int, optional
        Limit for every start. By default 300 and one for every variable; of an objective that
        CasADi evaluates, 300 at the most.
    n_starts : int, optional
        Starts of every instance: the given one and others around it, in the same pattern for every
        state. All are solved coarsely, and the least objective to tolerance. By default as many as
        the problem says are worth it (`Nlp.n_starts`).
    """

    tolerance: PositiveFinite = 1e-7
    max_iter: PositiveInt | None = None
    n_starts: PositiveInt | None = None

    name: ClassVar[str] = "spectral"
    summary: ClassVar[str] = (
        "compiled spectral projected gradient, in batches; boxes and discs only"
    )
    capabilities: ClassVar[Capabilities] = Capabilities("product sets", batch=True)

    @staticmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Whether the constraints are a product of boxes and discs, and given as such."""
        sets = instances.feasible_set
        return isinstance(sets, PlanarSets) and 2 * sets.shape[-1] == nlp.sizes[0]

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        if nlp.compiled is not None:
            _module(nlp)
        else:
            _ = nlp.gradient

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return self.run_batch(nlp, instances).answers()

    def run_batch(self, nlp: Nlp, instances: Instances) -> Run:
        """Solve and judge every instance; what it took stays in the `Run`."""
        run = Run.of(self, nlp, instances)
        run.solve()
        return run

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; every answer is judged, by the problem alone, as it is found.

        Stationarity is the largest component of x - P(x - grad f(x)), in `Instances.scale`; it
        needs no multipliers.
        """
        run = self.run_batch(nlp, instances)
        return run.solution(run.outcome == spg_kernels.CONVERGED)


@dataclass
class Run:
    """The arrays of one batch, contiguous as compiled code wants them."""

    solver: SpectralProjectedGradient
    nlp: Nlp
    product: PlanarSets
    units: FloatArray
    starts: FloatArray
    parameters: FloatArray
    x: FloatArray
    judged: FloatArray
    outcome: IntArray
    counts: IntArray
    seconds: float = 0.0

    @classmethod
    def of(cls, solver: SpectralProjectedGradient, nlp: Nlp, instances: Instances) -> Run:
        """Lay out the arrays; SolverError for problems of another kind."""
        if not solver.can_take(nlp, instances):
            raise SolverError(
                f"spectral cannot take {nlp.name}: it needs constraints that are products of boxes "
                "and discs in the plane"
            )
        assert isinstance(instances.feasible_set, PlanarSets)
        batch = len(instances)
        return cls(
            solver=solver,
            nlp=nlp,
            product=instances.feasible_set,
            units=_units(instances),
            starts=_starts(instances, solver.n_starts or nlp.n_starts),
            parameters=np.ascontiguousarray(instances.p),
            x=np.empty(instances.x0.shape),
            judged=np.empty((batch, 3)),
            outcome=np.empty(batch, np.int64),
            counts=np.zeros((batch, 2), np.int64),
        )

    def solve(self) -> None:
        """Fill x, judged, outcome and counts; each state alone, on any thread."""
        started = time.perf_counter()
        tolerance = self.solver.tolerance
        iterations = self.solver.max_iter or 300 + self.x.shape[1]
        if self.nlp.compiled is not None:
            minimise, shared = _module(self.nlp).minimise_batch, self.nlp.compiled.shared
            given = self.starts, self.parameters, shared, self.units, self.product.packed
            results = self.x, self.judged, self.outcome, self.counts

            def share(first: int, last: int) -> None:
                minimise(first, last, *given, tolerance, iterations, *results)

            in_threads(share, len(self.x), _SHARE)
        elif len(self.x):
            batch = spg_numpy.Batch(self.nlp, self.parameters, self.product, self.units)
            self.x, self.judged, self.outcome, self.counts = spg_numpy.minimise_batch(
                batch, self.starts, tolerance, iterations
            )
        self.seconds = time.perf_counter() - started

    def solution(self, success: BoolArray) -> BatchSolution:
        """The answers as arrays; none is a success that violates its constraints."""
        objective, violation, stationarity = self.judged.T
        return BatchSolution(
            x=self.x,
            objective=objective,
            success=success & (violation <= VIOLATION),
            violation=violation,
            stationarity=stationarity,
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
            )
            for i in range(len(self.x))
        ]


def _units(instances: Instances) -> FloatArray:
    """Units of x and f, (B, 2); ones where none are given."""
    units = np.ones((len(instances), 2)) if instances.scale is None else instances.scale
    return np.ascontiguousarray(units)


@lru_cache(maxsize=1)
def _pool(process: int) -> ThreadPoolExecutor:  # noqa: ARG001  (threads do not survive a fork)
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="casswarm")


def in_threads(work: Callable[[int, int], None], size: int, share: int) -> None:
    """Work on instances `first` to `last` - 1, on threads of at least `share` instances."""
    threads = min(os.cpu_count() or 1, size // share)
    if threads < 2:
        work(0, size)
        return
    ends = np.linspace(0, size, 4 * threads + 1).astype(int).tolist()
    list(_pool(os.getpid()).map(work, ends[:-1], ends[1:]))


def _starts(instances: Instances, number: int) -> FloatArray:
    """Starts (S, B, nx): the given one, and others around it that depend on the state alone."""
    if number == 1:
        return np.ascontiguousarray(instances.x0)[None]
    starts = np.repeat(instances.x0[None], number, axis=0)
    if number > 1:
        assert isinstance(instances.feasible_set, PlanarSets)
        radius = instances.feasible_set.radii.min(axis=-1, initial=np.inf)
        spread = _SPREAD * np.where(np.isfinite(radius), radius, 0.0)
        points = starts.reshape(number, *radius.shape, 2)  # a view
        # one pattern for all states, so that a state's answer does not depend on its batch
        pattern = np.random.default_rng(1).normal(size=(number - 1, 1, radius.shape[1], 2))
        points[1:] += spread[..., None] * pattern
    return starts


def _module(nlp: Nlp) -> ModuleType:
    assert nlp.compiled is not None
    return compiled_module(nlp.compiled.source, *_core())


@lru_cache(maxsize=1)
def _core() -> list[str]:
    return [inspect.getsource(core) for core in (planar_kernels, face_newton_kernels, spg_kernels)]

"""The nonmonotone spectral projected gradient, compiled, over batches."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..compiled.kernels import contiguous
from ..compiled.parallel import execute
from ..errors import SolverError
from ..motion.planar import PlanarSets
from ..nlp.program import Instances, Nlp
from ..nlp.solution import BatchSolution, Status
from ..solvers.base import VIOLATION, Answer, Capabilities, PositiveFinite, PositiveInt, Solver
from ..typing import BoolArray, FloatArray
from .objective import CompiledObjective, start_count
from .spectral_kernels import CONVERGED, EXHAUSTED, NO_INTERIOR, NOT_FINITE, STALLED, Results

if TYPE_CHECKING:
    from .search_kernels import Batch, Method


_MESSAGES = {
    CONVERGED: (Status.SOLVED, "stationary to tolerance"),
    EXHAUSTED: (Status.ITERATION_LIMIT, "iterations exhausted"),
    STALLED: (Status.FAILED, "no decrease along the search direction"),
    NOT_FINITE: (Status.FAILED, "objective, gradient or step not finite"),
    NO_INTERIOR: (Status.FAILED, "no point strictly within the limits"),
}


@dataclass(frozen=True, eq=False)
class BatchRun:
    """The answers of one batch: results with x as (B, nx), and the time they took."""

    results: Results
    seconds: float

    def solution(self, success: BoolArray) -> BatchSolution:
        """The answers as arrays; one that violates its constraints is never a success."""
        objective, violation, stationarity = self.results.verified.T
        return BatchSolution(
            x=self.results.x,
            objective=objective,
            success=success & (violation <= VIOLATION),
            violation=violation,
            stationarity=stationarity,
            used_fallback=np.zeros(len(success), bool),
            seconds=self.seconds,
            messages=np.full(len(success), "", dtype=object),
        )

    def answers(self) -> list[Answer]:
        """The answers one by one."""
        x, _, outcome, counts = self.results
        return [
            Answer(
                x[i],
                *_MESSAGES[int(outcome[i])],
                iterations=int(counts[i, 0]),
                evaluations=int(counts[i, 1]),
                seconds=self.seconds / len(x),
                multipliers=self.multipliers(i),
            )
            for i in range(len(x))
        ]

    def multipliers(self, i: int) -> tuple[FloatArray, FloatArray] | None:  # noqa: ARG002
        """Multipliers of the bounds and of g of an instance, where the method has them."""
        return None


class BatchSolver(Solver):
    """A solver that advances all instances together, for compiled objectives only."""

    @staticmethod
    @abstractmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Whether the objective is compiled and the feasible set is of the solver's kind."""

    @abstractmethod
    def run_batch(self, nlp: Nlp, instances: Instances) -> BatchRun:
        """Solve and verify every instance; SolverError where `can_take` is False."""

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        compiled = nlp.attached(CompiledObjective)
        if compiled is not None:
            _ = compiled.evaluate

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return self.run_batch(nlp, instances).answers()

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; residuals are recomputed from the problem, in its scale."""
        run = self.run_batch(nlp, instances)
        return run.solution(run.results.outcome == CONVERGED)


_PER_THREAD = 256  # instances that are worth a thread


@dataclass(frozen=True)
class SpectralProjectedGradient(BatchSolver):
    """SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000), state by state.

    For problems on products of boxes and discs with a `CompiledObjective` attached. Newton
    steps on the active face speed up its end.

    Parameters
    ----------
    tolerance : float
        A point x has converged when no component of x - P(x - grad f(x)) is larger, all in
        `Instances.scale`: an answer does not depend on the scenario's units.
    max_iter : int, optional
        Limit for every start. By default 300 and one for every variable.
    n_starts : int, optional
        Starts of every instance: the given one and others around it, in the same pattern for every
        state. All are solved coarsely, and the least objective to tolerance. Where they do not
        agree, more follow (``multistart_kernels.py``); with 1 there is no other start. By default
        as many as the problem says are worth it (`StartCount`).
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
        """Whether the objective is compiled, and the feasible set a product of planar sets."""
        sets = instances.feasible_set
        return (
            nlp.attached(CompiledObjective) is not None
            and isinstance(sets, PlanarSets)
            and 2 * sets.shape[-1] == nlp.sizes[0]
        )

    def run_batch(self, nlp: Nlp, instances: Instances) -> BatchRun:
        """Solve and verify every instance.

        Stationarity is the largest component of x - P(x - grad f(x)), in `Instances.scale`; it
        needs no multipliers.
        """
        if not self.can_take(nlp, instances):
            raise SolverError(
                f"spectral cannot take {nlp.name}: it needs constraints that are products of boxes "
                "and discs in the plane, and an objective made of kernels; take auto or ipopt",
                solver="spectral",
                problem=nlp.name,
            )
        from .search_kernels import minimise_batch  # Numba takes a second to import

        compiled = nlp.attached(CompiledObjective)
        assert compiled is not None
        data = batch_data(nlp, instances, instances.x0)
        results = Results.empty(instances.x0.shape)
        method = self.method(start_count(nlp), nlp.sizes[0] // 2)
        arguments = compiled.evaluate, data, method, results
        seconds = execute(minimise_batch, len(results.x), arguments, _PER_THREAD)
        return BatchRun(results, seconds)

    def method(self, n_starts: int, members: int) -> Method:
        """The options as kernels take them, with the program's `StartCount` as the default."""
        from .search_kernels import Method
        from .spectral_kernels import start_displacements

        initial = self.n_starts or n_starts
        directions = start_displacements(initial, members)
        return Method(initial, directions, self.tolerance, self.max_iter or 300 + 2 * members)


def batch_data(nlp: Nlp, instances: Instances, x0: FloatArray) -> Batch:
    """Arrays of B instances and their initial guesses (B, nx) for kernels on products of sets."""
    from .search_kernels import Batch

    compiled = nlp.attached(CompiledObjective)
    assert compiled is not None
    assert isinstance(instances.feasible_set, PlanarSets)
    return Batch(
        x0=contiguous(x0),
        p=contiguous(instances.p),
        constants=compiled.constants,
        scale=contiguous(instances.scale),
        sets=instances.feasible_set.packed,
    )

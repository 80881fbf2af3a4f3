"""Projected gradient methods over batches: the nonmonotone spectral one, and the paper's.

The paper's has a constant step and exact projections.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from typing_extensions import override

from .._util.threads import locked_cache
from ..compiled.kernels import contiguous
from ..compiled.parallel import execute
from ..errors import SolverError
from ..motion.planar import PlanarSets
from ..nlp.program import Instances, Nlp
from ..nlp.solution import BatchSolution, Status
from ..solvers.base import (
    VIOLATION,
    Answer,
    Capabilities,
    IterateLog,
    Iterates,
    NonNegative,
    NonNegativeInt,
    PositiveFinite,
    PositiveInt,
    Solver,
)
from ..typing import BoolArray, FloatArray
from .multistart_kernels import Batch, minimise_batch
from .objective import CompiledObjective, start_count
from .search_kernels import Method
from .spectral_kernels import (
    CONVERGED,
    EXHAUSTED,
    NO_INTERIOR,
    NOT_FINITE,
    STALLED,
    Results,
    start_displacements,
)

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
    instances: Instances

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
            lam_x=np.broadcast_to(np.nan, self.results.x.shape),
            lam_g=np.broadcast_to(np.nan, self.instances.lbg.shape),
            iterations=self.results.counts[:, 0],
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
        """Return True if the objective is compiled and the feasible set is of the solver's kind."""

    @abstractmethod
    def run_batch(self, nlp: Nlp, instances: Instances) -> BatchRun:
        """Solve and verify every instance; SolverError where `can_take` is False."""

    @override
    def prepare(self, nlp: Nlp) -> None:
        compiled = nlp.attached(CompiledObjective)
        if compiled is not None:
            _ = compiled.evaluate

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        return self.run_batch(nlp, instances).answers()

    def solve_batch(
        self, nlp: Nlp, instances: Instances, *, sensitivities: bool = False
    ) -> BatchSolution:
        """Solve every instance; residuals are recomputed from the problem, in its scale."""
        if sensitivities:
            return super().solve_batch(nlp, instances, sensitivities=True)
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
        agree, more follow (``spectral_kernels.py``); with 1 there is no other start. By default
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
        """Return True if the objective is compiled, and the set a product of planar sets."""
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
        method = self.method(start_count(nlp), nlp.sizes[0] // 2)
        return _compiled_run(nlp, instances, instances.x0, method, _PER_THREAD)

    def method(self, n_starts: int, members: int) -> Method:
        """The options as kernels take them, with the program's `StartCount` as the default."""
        initial = self.n_starts or n_starts
        directions = start_displacements(initial, members)
        return Method(initial, directions, self.tolerance, self.max_iter or 300 + 2 * members)


def _compiled_run(
    nlp: Nlp, instances: Instances, x0: FloatArray, method: Method, per_thread: int
) -> BatchRun:
    """Answers on products of sets from initial guesses (B, nx)."""
    instances.require_fit(nlp)
    compiled = nlp.attached(CompiledObjective)
    assert compiled is not None
    assert isinstance(instances.feasible_set, PlanarSets)
    data = Batch(
        x0=contiguous(x0),
        p=contiguous(instances.p),
        scale=contiguous(instances.scale),
        sets=instances.feasible_set.packed,
    )
    results = Results.empty(x0.shape)
    arguments = *compiled.kernels, data, method, results
    seconds = execute(minimise_batch, len(x0), arguments, per_thread)
    return BatchRun(results, seconds, instances)


_CHUNK = 256  # instances evaluated at once
_STEPS_PER_THREAD = 4  # instances that are worth a thread, with a constant step


@dataclass(frozen=True)
class ProjectedGradient(Solver):
    """x <- P(x - step grad f(x)), the paper's algorithm of sections III and IV.

    Bertsekas, Tsitsiklis, Parallel and Distributed Computation, section 3.3.2. For problems whose
    constraints are a box, or a product of boxes and discs in the plane (`Instances.feasible_set`).
    Batched, and compiled with a `CompiledObjective`; each instance stops on its own.

    Parameters
    ----------
    step : float
        The paper's learning rate.
    x_scale : float
        Unit of x: steps are taken in x / x_scale, as in `scipy.optimize.least_squares`, so a
        component of x moves by step x_scale^2 times its derivative. With 1 / dt, velocities become
        displacements, the variable of the paper's X(t+1) = X(t) + V(t): plans and policies pass
        this value when the solver is given by name. 1 steps in velocities, dt^2 as far.
    max_iter : int
        The paper's number of iterations. Reaching it is no success of an optimiser, but the normal
        end of this method: policies apply the iterate, and count as failed only what is not finite
        or not feasible.
    tolerance : float
        An instance has converged when no component of x / x_scale moves by more than `tolerance`
        times the step in one iteration.
    keep : {"last", "best"}
        Which iterate is the answer: the last, or the one with the smallest objective (with a
        constant step the iterates may circle around a kink).
    start : {"x0", "zero"}
        Initial guess: that of the instance, or the projection of zero, as in the paper for the
        formation.
    """

    step: PositiveFinite = 0.05
    x_scale: PositiveFinite = 1.0
    max_iter: NonNegativeInt = 2000
    tolerance: NonNegative = 1e-6
    keep: Literal["last", "best"] = "last"
    start: Literal["x0", "zero"] = "x0"

    name: ClassVar[str] = "projected-gradient"
    summary: ClassVar[str] = "the paper's constant-step method; boxes and discs only"
    capabilities: ClassVar[Capabilities] = Capabilities(
        "product sets", batch=True, fixed_iterations=True
    )

    @override
    def prepare(self, nlp: Nlp) -> None:
        compiled = nlp.attached(CompiledObjective)
        _ = nlp.gradient if compiled is None else compiled.evaluate

    @override
    def solve_batch(
        self, nlp: Nlp, instances: Instances, *, sensitivities: bool = False
    ) -> BatchSolution:
        if sensitivities:
            return super().solve_batch(nlp, instances, sensitivities=True)
        if not self._is_compiled(nlp, instances):
            return super().solve_batch(nlp, instances)
        run = self._run_compiled(nlp, instances)
        return run.solution(run.results.outcome == CONVERGED)

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        if self._is_compiled(nlp, instances):
            return self._run_compiled(nlp, instances).answers()
        _require_product(nlp, instances)
        answers: list[Answer] = []
        for start in range(0, len(instances), _CHUNK):
            answers += self._run_chunk(nlp, instances[slice(start, start + _CHUNK)])
        return answers

    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """See `Solver.iterates`; they are computed by the loop that is not compiled."""
        _require_product(nlp, instance)
        log = IterateLog()
        self._run_chunk(nlp, instance, log)
        return log.iterates(instance.x0[0, :0])

    def _is_compiled(self, nlp: Nlp, instances: Instances) -> bool:
        return self.keep == "last" and SpectralProjectedGradient.can_take(nlp, instances)

    def _initial(self, instances: Instances) -> FloatArray:
        return np.zeros_like(instances.x0) if self.start == "zero" else instances.x0

    def _run_compiled(self, nlp: Nlp, instances: Instances) -> BatchRun:
        x0, directions = self._initial(instances), start_displacements(1, nlp.sizes[0] // 2)
        step, tolerance = self.step * self.x_scale**2, self.tolerance / self.x_scale
        method = Method(1, directions, tolerance, self.max_iter, step)
        return _compiled_run(nlp, instances, x0, method, _STEPS_PER_THREAD)

    def _run_chunk(
        self,
        nlp: Nlp,
        instances: Instances,
        callback: Callable[[FloatArray], object] = lambda _: None,
    ) -> list[Answer]:
        started = time.perf_counter()
        x = _project(instances, self._initial(instances))
        step_size = self.step * self.x_scale**2
        least_change = self.tolerance * self.step * self.x_scale
        answer, smallest = x.copy(), np.full(len(x), np.inf)
        iterations = np.full(len(x), self.max_iter)
        converged = np.zeros(len(x), bool)
        active, remaining = np.arange(len(x)), instances
        gradients = _Gradients(nlp, instances.p)
        callback(x)
        for iteration in range(self.max_iter):
            objective, gradient = gradients(x[active])
            if self.keep == "best":
                better = objective < smallest[active]
                smallest[active[better]] = objective[better]
                answer[active[better]] = x[active[better]]
            step = x[active] - step_size * gradient
            finite: BoolArray = np.asarray(np.isfinite(step).all(axis=1))
            projected = _project(remaining, np.where(finite[:, None], step, x[active]))
            change = np.abs(projected - x[active]).max(axis=1, initial=0.0)
            x[active] = np.where(finite[:, None], projected, np.nan)
            callback(x)
            done: BoolArray = np.asarray(~finite | (change <= least_change))
            if done.any():
                iterations[active[done]] = iteration + 1
                converged[active[done]] = finite[done]
                active = active[~done]
                if not active.size:
                    break
                remaining = instances[active]
                gradients = _Gradients(nlp, remaining.p)
        diverged: BoolArray = np.asarray(~np.isfinite(x).all(axis=1))
        if self.keep == "last":
            answer = x
        seconds = (time.perf_counter() - started) / max(1, len(x))
        return [
            Answer(
                answer[i],
                *_outcome(diverged[i], converged[i]),
                int(iterations[i]),
                int(iterations[i]),
                seconds,
            )
            for i in range(len(x))
        ]


def _require_product(nlp: Nlp, instances: Instances) -> None:
    if nlp.constraints and not isinstance(instances.feasible_set, PlanarSets):
        raise SolverError(
            f"projected-gradient cannot solve {nlp.name}: its constraints "
            f"({', '.join(nlp.constraints)}) are not a product of boxes and discs",
            solver="projected-gradient",
            problem=nlp.name,
            constraints=tuple(nlp.constraints),
        )


def _outcome(diverged: np.bool_, converged: np.bool_) -> tuple[Status, str]:
    if diverged:
        return Status.FAILED, "gradient not finite"
    if converged:
        return Status.SOLVED, "step below tolerance"
    return Status.ITERATION_LIMIT, "iterations exhausted"


def _project(instances: Instances, x: FloatArray) -> FloatArray:
    sets = instances.feasible_set
    if not isinstance(sets, PlanarSets):
        return np.clip(x, instances.lbx, instances.ubx)
    return sets.project(x.reshape(*sets.shape, 2)).reshape(x.shape)


class _Gradients:
    """Objectives (B,) and gradients (B, nx) of B instances, evaluated without copies by CasADi."""

    def __init__(self, nlp: Nlp, parameters: FloatArray) -> None:
        self.count = len(parameters)
        size = 1 << max(0, self.count - 1).bit_length()  # so that few sizes are built
        self.x, self.gradient = np.zeros((size, nlp.sizes[0])), np.empty((size, nlp.sizes[0]))
        self.p: FloatArray = np.resize(parameters, (size, nlp.sizes[1]))
        self.objective = np.empty(size)
        buffer, self.evaluate = _mapped(nlp, size).buffer()
        for index, array in enumerate((self.x, self.p)):
            buffer.set_arg(index, memoryview(array))  # type: ignore[arg-type]
        for index, array in enumerate((self.objective, self.gradient)):
            buffer.set_res(index, memoryview(array))  # type: ignore[arg-type]
        self.buffer = buffer

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values at x (B, nx), not finite where they do not exist; overwritten by the next call."""
        self.x[: self.count] = x
        self.evaluate()
        return self.objective[: self.count], self.gradient[: self.count]


@locked_cache(maxsize=64)
def _mapped(nlp: Nlp, size: int) -> Any:
    return nlp.gradient.map(size)

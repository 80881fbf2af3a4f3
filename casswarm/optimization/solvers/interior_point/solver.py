"""The interior-point method as a solver."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, ClassVar

import numpy as np

from ...._util.interrupts import interruptible
from ...._util.user_code import USER_ERRORS
from ...problem import Instances, Nlp
from ...solution import BatchSolution, Status
from ..base import VIOLATION, Answer, Capabilities, Solver, backend_error
from ..options import Allowed, Flag, NonNegative, NonNegativeInt, Positive
from .compiled_problems import numeric_problems, program_tapes
from .engine import minimise
from .iterates import Options, Results
from .lane_kernels import LANES

_ENTRIES = 1 << 16  # of x and g of the instances that advance together, which fit in a cache
_NUMERIC = 1 << 14  # likewise, with derivatives of their own
_DENSE = 1 << 22  # of their matrices, where those are dense
_WIDEST = 8 * LANES

Fallback = Annotated[
    Solver | None,
    Allowed(lambda value: value is None or isinstance(value, Solver), "a Solver, or None"),
]


@dataclass(frozen=True)
class FilterInteriorPoint(Solver):
    """Primal-dual interior point with a filter line search; many instances advance together.

    The method of Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), without its scaling and
    with a simpler restoration phase, with exact second derivatives: for programs of up to some
    hundred variables.
    Derivatives and Cholesky factors are lists of scalar operations, which compiled loops do for 64
    instances at a time; programs with operations that are not scalar are evaluated by CasADi.

    Parameters
    ----------
    tolerance : float
        Of the optimality conditions, relative to large multipliers.
    constraint_tolerance : float
        Largest violation of a constraint.
    max_iter : int
    mu_init : float
        Initial barrier parameter: a smaller one stays nearer to a good guess.
    bound_push : float
        Relative distance by which the initial guess is moved away from its bounds.
    constr_mult_init_max : float
        Largest initial multiplier of a constraint that is estimated by least squares; 0 for none.
    restoration : bool
        Whether the violation of the constraints is reduced first where the line search finds no
        better point. Otherwise such an instance ends without a solution.
    fallback : Solver, optional
        Solves, from their initial guesses, the instances that are not solved.
    """

    tolerance: Positive = 1e-8
    constraint_tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    mu_init: Positive = 0.1
    bound_push: Positive = 0.01
    constr_mult_init_max: NonNegative = 1000.0
    restoration: Flag = True
    fallback: Fallback = None

    name: ClassVar[str] = "interior-point"
    summary: ClassVar[str] = "interior point over batches, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(batch=True, multipliers=True)

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        if nlp.numeric is None:
            program_tapes(nlp)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        results, seconds = self._results(nlp, instances)
        each = seconds / max(1, len(instances))
        answers = [_answer(results, i, each) for i in range(len(instances))]
        left = np.flatnonzero(~_verified(nlp, instances, results, seconds).success)
        if self.fallback is not None and left.size:
            again = self.fallback.timed_answers(nlp, instances[left])[1]
            for i, answer in zip(left, again, strict=True):
                message = f"by {self.fallback.name}: {answer.message}"
                answers[i] = replace(answer, message=message, seconds=answer.seconds + each)
        return answers

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; residuals are recomputed for all of them at once.

        Stationarity is the larger of the Lagrangian's gradient and of complementarity, in
        `Instances.scale`. `BatchSolution.used_fallback` marks those that the fallback solved.
        """
        try:
            with interruptible():
                results, seconds = self._results(nlp, instances)
                solution = _verified(nlp, instances, results, seconds)
        except USER_ERRORS as error:  # of a function that the user wrote: of one instance, perhaps
            backend_error(error)
            return super().solve_batch(nlp, instances)
        left = np.flatnonzero(~solution.success)
        if self.fallback is None or not left.size:
            return solution
        again = self.fallback.solve_batch(nlp, instances[left])
        return solution.with_rows(left, replace(again, used_fallback=np.ones(left.size, bool)))

    def _results(self, nlp: Nlp, instances: Instances) -> tuple[Results, float]:
        """Results of all instances, and seconds."""
        options = Options(
            self.tolerance,
            self.constraint_tolerance,
            self.mu_init,
            self.bound_push,
            self.max_iter,
            self.constr_mult_init_max,
            self.restoration,
        )
        started = time.perf_counter()
        with _blas_threads().limit(limits=1, user_api="blas"):
            results = minimise(numeric_problems(nlp, instances.p), instances, options, _width(nlp))
        results.x = np.clip(results.x, instances.lbx, instances.ubx)  # of bounds that were moved
        return results, time.perf_counter() - started


def _width(nlp: Nlp) -> int:
    """How many instances advance together: whole lanes, or fewer where matrices are dense."""
    variables, _, rows = nlp.sizes
    if nlp.numeric is not None:
        return max(1, min(_WIDEST, _NUMERIC // (variables + rows + 1)))
    tapes = program_tapes(nlp)
    if tapes is None or tapes.system is None:
        return max(1, min(_WIDEST, _DENSE // max(1, variables) ** 2))
    lanes = _ENTRIES // (variables + rows + 1) // LANES
    return int(np.clip(lanes * LANES, LANES, _WIDEST))


def _answer(results: Results, i: int, seconds: float) -> Answer:
    return Answer(
        results.x[i],
        results.status[i],
        results.message[i],
        int(results.iterations[i]),
        int(results.evaluations[i]),
        seconds,
        (results.lam_x[i], results.lam_g[i]),
    )


def _verified(nlp: Nlp, instances: Instances, results: Results, seconds: float) -> BatchSolution:
    """Results with residuals recomputed from the problem."""
    problems, rows = numeric_problems(nlp, instances.p), np.arange(len(instances))
    x, lam_x, lam_g = results.x, results.lam_x, results.lam_g
    by_column = np.ascontiguousarray(x.T)
    objective, g_by_column = problems.evaluate(rows, by_column)
    at, g = problems.linearise(rows, by_column), g_by_column.T
    lagrangian = (at.gradient + at.transposed_times(np.ascontiguousarray(lam_g.T))).T + lam_x
    values = np.hstack([x, g])
    below = np.hstack([instances.lbx, instances.lbg]) - values
    above = values - np.hstack([instances.ubx, instances.ubg])
    violation = np.maximum(below, above).max(axis=1, initial=0.0)
    gradient = abs(lagrangian).max(axis=1, initial=0.0)
    lam = np.hstack([lam_x, lam_g])
    slack = np.where(lam > 0.0, above, below)
    products = abs(lam * np.where(np.isfinite(slack), slack, 1.0))  # as `kkt_residuals`
    length, value = instances.scale.T
    stationarity = np.maximum(length / value * gradient, products.max(axis=1, initial=0.0) / value)
    solved = np.array([status.success for status in results.status], dtype=bool)
    success = solved & (violation <= VIOLATION) & np.isfinite(objective + stationarity)
    messages = [
        f"{Status.FAILED if status.success and not verified else status}: {message}"
        for status, message, verified in zip(results.status, results.message, success, strict=True)
    ]
    return BatchSolution(
        x=x,
        objective=objective,
        success=success,
        violation=violation,
        stationarity=stationarity,
        used_fallback=np.zeros(len(instances), bool),
        seconds=seconds,
        messages=np.array(messages, dtype=object),
    )


@cache
def _blas_threads() -> Any:
    """The thread pools of BLAS: several would wait for each other on a busy machine."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()

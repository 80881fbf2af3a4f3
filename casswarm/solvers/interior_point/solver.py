"""The interior-point method as a solver, and the verification of its answers."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from typing_extensions import override

from ..._util.interrupts import interruptible
from ..._util.threads import one_blas_thread
from ..._util.user_code import USER_ERRORS
from ...nlp.program import Instances, Nlp
from ...nlp.solution import BatchSolution, Status
from ...typing import FloatArray, IntArray
from ..base import (
    VIOLATION,
    Allowed,
    Answer,
    Capabilities,
    Flag,
    IterateLog,
    Iterates,
    NonNegative,
    NonNegativeInt,
    Positive,
    Solver,
    backend_error,
    differentiated,
)
from .derivatives import NumericDerivatives, Problems, numeric_problems, program_functions
from .engine import Recorder, minimise
from .iterate_kernels import LANES
from .iterates import DIVERGENT, Options, Results, are_equal
from .scaling import ScaledProblems, Scaling

STATIONARITY = 1e-4
"""Largest residual of the optimality conditions in the method's units, relative to multipliers."""

_UNSCALED = 1e-4  # largest stationarity in `Instances.scale`
NO_MULTIPLIERS = "no multipliers found: a constraint qualification seems to fail (Fritz John point)"
"""Message on points that are stationary only relative to multipliers without bound."""


def verified(nlp: Nlp, instances: Instances, results: Results, scaling: Scaling) -> BatchSolution:
    """Results with residuals of the program.

    Solutions without feasibility, stationarity or finite values are failures.
    """
    problems, width, size = numeric_problems(nlp, instances.p), _width(nlp), len(instances)
    objective, violation, gradient, products = np.empty((4, size))
    with np.errstate(all="ignore"):
        for start in range(0, size, width):
            some = slice(start, min(start + width, size))
            objective[some], violation[some], gradient[some], products[some] = _residuals(
                problems, instances[some], results, np.arange(size)[some]
            )
        length, value = instances.scale.T
        stationarity = np.maximum(length / value * gradient, products / value)
        relative = scaling.objective * np.maximum(scaling.length * gradient, products)
        largest = _largest_multipliers(results, scaling)
        relative /= np.maximum(1.0, largest)
    claimed = np.array([status.success for status in results.status], dtype=bool)
    unscaled, divergent = stationarity > _UNSCALED, largest > DIVERGENT
    faults = {
        "a residual is not finite": ~np.isfinite(objective + stationarity + violation),
        f"a constraint is violated by more than {VIOLATION:g}": violation > VIOLATION,
        "the point is not stationary": (relative > STATIONARITY) | (unscaled & ~divergent),
        NO_MULTIPLIERS: unscaled & divergent,
    }
    messages = np.array(
        [f"{status}: {text}" for status, text in zip(results.status, results.message, strict=True)],
        dtype=object,
    )
    for text, faulty in faults.items():
        messages[claimed & faulty] = f"{Status.FAILED}: {text}"
        claimed &= ~faulty
    return BatchSolution(
        x=results.x,
        objective=objective,
        success=claimed,
        violation=violation,
        stationarity=stationarity,
        used_fallback=np.zeros(size, bool),
        seconds=0.0,
        messages=messages,
        lam_x=results.lam_x,
        lam_g=results.lam_g,
        iterations=results.iterations,
    )


def _residuals(
    problems: Problems, instances: Instances, results: Results, rows: IntArray
) -> tuple[FloatArray, ...]:
    """Objective, violation, largest entry of the Lagrangian's gradient, and complementarity."""
    x, lam_x, lam_g = (part[rows] for part in (results.x, results.lam_x, results.lam_g))
    by_column = np.ascontiguousarray(x.T)
    objective, g = problems.evaluate(rows, by_column)
    at = problems.linearise(rows, by_column)
    lagrangian = (at.gradient + at.transposed_times(np.ascontiguousarray(lam_g.T))).T + lam_x
    values, lam = np.hstack([x, g.T]), np.hstack([lam_x, lam_g])
    below = np.hstack([instances.lbx, instances.lbg]) - values
    above = values - np.hstack([instances.ubx, instances.ubg])
    slack = np.where(lam > 0.0, above, below)
    slack[:, : x.shape[1]][are_equal(instances.lbx, instances.ubx)] = 0.0
    products = abs(lam * np.where(np.isfinite(slack), slack, 1.0))  # as `kkt_residuals`
    return (
        objective,
        np.maximum(below, above).max(axis=1, initial=0.0),
        abs(lagrangian).max(axis=1, initial=0.0),
        products.max(axis=1, initial=0.0),
    )


def _largest_multipliers(results: Results, scaling: Scaling) -> FloatArray:
    """Largest absolute multipliers (B,) in the method's units."""
    of_x = abs(results.lam_x).max(axis=1, initial=0.0) * scaling.length
    of_g = (abs(results.lam_g) / scaling.rows.T).max(axis=1, initial=0.0)
    return np.asarray(scaling.objective * np.maximum(of_x, of_g))


_ENTRIES = 1 << 16  # of x and g of the instances that advance together, which fit in a cache
_NUMERIC = 1 << 14  # likewise, with derivatives of their own
_DENSE = 1 << 22  # of their matrices, where those are dense
_WIDEST = 8 * LANES
_ULPS = 1e-15  # relative distance to a bound at which a variable is there

Fallback = Annotated[
    Solver | None,
    Allowed(lambda value: value is None or isinstance(value, Solver), "a Solver, or None"),
]


@dataclass(frozen=True)
class FilterInteriorPoint(Solver):
    """Primal-dual interior point with a filter line search; many instances advance together.

    The method of Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), with a simpler restoration
    phase, and exact second derivatives: for programs of up to some thousand variables whose
    derivatives are sparse. Derivatives are lists of scalar operations, which compiled loops do for
    64 instances at a time, like Cholesky factors of one pattern; programs with operations that are
    not scalar are evaluated by CasADi.

    Parameters
    ----------
    tolerance : float
        Of the optimality conditions, relative to large multipliers.
    constraint_tolerance : float
        Largest violation of a constraint.
    max_iter : int
    mu_init : float
        Initial barrier parameter, relative to `Instances.scale`: a smaller one stays nearer to a
        good guess.
    bound_push : float
        Relative distance by which the initial guess is moved away from its bounds.
    constr_mult_init_max : float
        Largest initial multiplier of a constraint that is estimated by least squares; 0 for none.
    restoration : bool
        Whether the violation of the constraints is reduced first where the line search finds no
        better point; where there is hardly any violation, or the multipliers diverge, the instance
        is solved again with bounds relaxed by up to `constraint_tolerance`, and 1e-8 relative to
        those above 1, as by Ipopt. Otherwise such an instance ends without a solution.
    scaling : bool
        Whether to solve in units of `Instances.scale`, and of the gradients of f and g at the
        initial guess where those are large or small.
    fallback : Solver, optional
        Solves, from their initial guesses, the instances that are not solved. Its points have to be
        stationary too. If it has a time limit, that of each is its share of what is left.
    time_limit : float
        Seconds of a call, for all its instances together: those that are not solved then end. The
        method has half of them where there is a fallback.
    """

    tolerance: Positive = 1e-8
    constraint_tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    mu_init: Positive = 0.1
    bound_push: Positive = 0.01
    constr_mult_init_max: NonNegative = 1000.0
    restoration: Flag = True
    scaling: Flag = True
    fallback: Fallback = None
    time_limit: Positive = math.inf

    name: ClassVar[str] = "interior-point"
    summary: ClassVar[str] = "interior point over batches, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(
        batch=True, multipliers=True, time_limit=True
    )

    @override
    def prepare(self, nlp: Nlp) -> None:
        if nlp.attached(NumericDerivatives) is None:
            program_functions(nlp)

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        started = time.perf_counter()
        results, scaling = self._results(nlp, instances)
        each = (time.perf_counter() - started) / max(1, len(instances))
        answers = [_answer(results, i, each) for i in range(len(instances))]
        solution = verified(nlp, instances, results, scaling)
        left = np.flatnonzero(~solution.success)
        for i in left:
            if answers[i].status.success:
                message = str(solution.messages[i])
                answers[i] = replace(answers[i], status=Status.FAILED, message=message)
        if self.fallback is not None and left.size:
            fallback = self._fallback(started, left.size)
            again = fallback.timed_answers(nlp, instances[left])[1]
            for i, answer in zip(left, again, strict=True):
                checked = _checked(nlp, instances[i : i + 1], answer, fallback)
                answers[i] = replace(checked, seconds=answer.seconds + each)
        return answers

    @override
    def solve_batch(
        self, nlp: Nlp, instances: Instances, *, sensitivities: bool = False
    ) -> BatchSolution:
        """Solve every instance; residuals are recomputed for all of them at once.

        Stationarity is the larger of the Lagrangian's gradient and of complementarity, in
        `Instances.scale`. `BatchSolution.used_fallback` marks those that the fallback solved.
        With `sensitivities`, the solution has derivatives by the parameters (`Sensitivities`).
        """
        instances.require_fit(nlp)
        started = time.perf_counter()
        try:
            with interruptible():
                results, scaling = self._results(nlp, instances)
                seconds = time.perf_counter() - started
                solution = verified(nlp, instances, results, scaling)
        except USER_ERRORS as error:  # of a function that the user wrote: of one instance, perhaps
            backend_error(error)
            return super().solve_batch(nlp, instances, sensitivities=sensitivities)
        solution = replace(solution, seconds=seconds)
        left = np.flatnonzero(~solution.success)
        if self.fallback is not None and left.size:
            again = self._fallback(started, left.size).solve_batch(nlp, instances[left])
            faulty = again.success & ~(again.stationarity <= _UNSCALED)
            again.messages[faulty] = f"{Status.FAILED}: the point is not stationary"
            success, used = again.success & ~faulty, np.ones(left.size, bool)
            again = replace(again, success=success, used_fallback=used)
            solution = solution.with_rows(left, again)
        return differentiated(nlp, instances, solution) if sensitivities else solution

    @override
    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """Points of every iteration, of which the first is the initial guess inside its bounds.

        Those of restoration and of the fallback are left out.
        """
        log = IterateLog()
        _, scaling = self._results(nlp, instance, log)
        return log.iterates(instance.x0[0, :0], float(scaling.length[0]))

    def _fallback(self, started: float, count: int) -> Solver:
        """The fallback of some instances, with a share of the time that is left."""
        fallback, limit = self.fallback, getattr(self.fallback, "time_limit", 0.0)
        assert fallback is not None
        left = self.time_limit + started - time.perf_counter()
        share = max(left, 0.1 * self.time_limit) / count
        return fallback if limit <= share else replace(fallback, time_limit=share)  # type: ignore

    def _results(
        self, nlp: Nlp, instances: Instances, record: Recorder | None = None
    ) -> tuple[Results, Scaling]:
        """Results of all instances, in their units, and the scaling that was used."""
        share = 1.0 if self.fallback is None else 0.5
        deadline = time.perf_counter() + share * self.time_limit
        problems, width = numeric_problems(nlp, instances.p), _width(nlp)
        with one_blas_thread(), np.errstate(all="ignore"):  # numbers that are not finite are judged
            scaling = Scaling.none(instances)
            if self.scaling:
                scaling = Scaling.of(problems, instances, width)
            accuracy = max(0.5 * _UNSCALED, self.tolerance) * scaling.objective
            own = {k: value for k, value in vars(self).items() if k in Options.__dataclass_fields__}
            options = Options(**own, accuracy=accuracy * instances.scale[:, 1], deadline=deadline)
            if scaling.trivial:
                results = minimise(problems, instances, options, width, record)
            else:
                scaled = ScaledProblems(problems, scaling), scaling.scaled(instances)
                results = minimise(*scaled, options, width, record)
                scaling.restore(results)
            low, high, near = instances.lbx, instances.ubx, _ULPS * abs(results.x)
            # bounds may have been moved
            results.x = np.where(results.x - low <= near, low, results.x)
            results.x = np.where(high - results.x <= near, high, results.x)
        return results, scaling


def _width(nlp: Nlp) -> int:
    """Number of instances that advance together: whole lanes, or fewer where matrices are dense."""
    variables, _, rows = nlp.sizes
    if nlp.attached(NumericDerivatives) is not None:
        return max(1, min(_WIDEST, _NUMERIC // (variables + rows + 1)))
    if program_functions(nlp).system is None:
        return max(1, min(_WIDEST, _DENSE // max(1, variables) ** 2))
    lanes = _ENTRIES // (variables + rows + 1) // LANES
    return int(np.clip(lanes * LANES, LANES, _WIDEST))


def _checked(nlp: Nlp, instance: Instances, answer: Answer, fallback: Solver) -> Answer:
    """Answer of the fallback, whose successes are verified, and whose method is local too."""
    message, status = f"by {fallback.name}: {answer.message}", answer.status
    found, (length, value) = fallback.verified(nlp, instance, answer).residuals, instance.scale[0]
    error = max(length * found.stationarity, found.complementarity) / value
    if status.success and not (found.violation <= VIOLATION and error <= _UNSCALED):
        message, status = f"{message}, but the point is not verified", Status.FAILED
    elif status is Status.INFEASIBLE:
        message, status = f"{message}, perhaps only locally", Status.FAILED
    return replace(answer, message=message, status=status)


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

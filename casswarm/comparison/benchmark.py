"""Benchmark of one solver on one problem from one start."""

from __future__ import annotations

import math
import statistics
import timeit
from typing import Any

from ..errors import SolverError
from ..optimization.kkt import relative_error
from ..optimization.problem import Instances, Nlp
from ..optimization.solvers import Answer, Isolated
from .convergence import iterate_columns, longest
from .perturbation import ProblemCopy
from .verification import NOT_APPLICABLE

MAX_SOLVES = 5
"""Largest number of solves, whose median is the time."""

EXTRA_SECONDS = 0.3
"""Time for solves after the first one, if that took at most ten times as long."""


def benchmark(
    copy: ProblemCopy, start: str, label: str, solver: Isolated, record_iterates: bool = False
) -> dict[str, Any]:
    """Row of one solver on one copy of a problem from one start, as plain values.

    Answers are mapped back to the original problem, and verified there.

    Columns: family, problem, copy, start, solver; reported_status, and status (reported_status,
    unless that is a success and the answer is not finite or violates the constraints); message,
    the solver's own; objective; violation, absolute, and violated_row, its row; stationarity and
    complementarity, relative to the problem's scale; relative_error, from
    `casswarm.optimization.kkt.relative_error`; iterations; evaluations; build_seconds;
    solve_seconds, the median of `solves` solves, and time_ratio, the slowest over the fastest;
    objective_scale; gradient_seconds, the time of an evaluation of objective and gradient; and
    iterates, from `casswarm.comparison.convergence.iterate_columns`, empty if they are not to be
    recorded, for perturbed copies, and where a solve takes long.
    """
    problem, posed = copy.problem, copy.starts[start]
    nlp, instance = problem.nlp, problem.starts[start]
    length, value = instance.scale[0].tolist()
    reference = next(iter(problem.starts.values())).x0[0]  # the same for all starts and copies
    row: dict[str, Any] = {
        "family": problem.family,
        "problem": problem.name,
        "copy": copy.number,
        "start": start,
        "solver": label,
    }
    try:
        build, (answer,) = solver.timed_answers(copy.nlp, posed)
    except SolverError as error:
        return row | _no_answer(str(error), value)
    times = _solve_times(solver, copy.nlp, posed, answer)
    restored = copy.restored(answer)
    solution = solver.verified(nlp, instance, restored, build)
    residuals, seconds = solution.residuals, statistics.median(times)
    recorded = record_iterates and not copy.number and seconds <= longest(solver.time_limit)
    return row | {
        "reported_status": str(answer.status),
        "status": str(solution.status),
        "message": solution.message,
        "objective": solution.objective,
        "violation": residuals.violation,
        "violated_row": residuals.violated_row,
        "stationarity": residuals.stationarity * length / value,
        "complementarity": residuals.complementarity / value,
        "relative_error": relative_error(
            nlp, instance, solution.x, restored.multipliers, reference
        ),
        "iterations": int(solution.iterations),
        "evaluations": int(solution.evaluations),
        "build_seconds": build,
        "solve_seconds": seconds,
        "solves": len(times),
        "time_ratio": max(times) / min(times) if len(times) > 1 and min(times) > 0 else math.nan,
        "objective_scale": value,
        "gradient_seconds": _gradient_seconds(nlp, instance),
        "iterates": iterate_columns(problem, start, solver, seconds) if recorded else {},
    }


def _no_answer(message: str, objective_scale: float) -> dict[str, Any]:
    """Row of a solver that does not support the problem."""
    numbers = ("objective", "violation", "stationarity", "complementarity", "relative_error")
    seconds = ("build_seconds", "solve_seconds", "time_ratio", "gradient_seconds")
    return {
        "reported_status": NOT_APPLICABLE,
        "status": NOT_APPLICABLE,
        "message": message,
        **dict.fromkeys((*numbers, *seconds), math.nan),
        **dict.fromkeys(("iterations", "evaluations", "solves"), 0),
        "violated_row": "",
        "objective_scale": objective_scale,
    }


def _solve_times(solver: Isolated, nlp: Nlp, instance: Instances, answer: Answer) -> list[float]:
    """Seconds of the first solve and, if that was a success and fast, of further ones."""
    times = [float(answer.seconds)]
    if not answer.status.success or times[0] > 10 * EXTRA_SECONDS:
        return times
    while len(times) < MAX_SOLVES and sum(times[1:]) < EXTRA_SECONDS:
        _, (repeated,) = solver.timed_answers(nlp, instance)
        if repeated.status is not answer.status:
            break
        times.append(float(repeated.seconds))
    return times


def _gradient_seconds(nlp: Nlp, instance: Instances) -> float:
    x, p = instance.x0[0], instance.p[0]
    return statistics.median(timeit.repeat(lambda: nlp.gradient(x, p), number=1, repeat=7))

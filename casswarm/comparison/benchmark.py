"""Benchmark of one solver on one problem from one start."""

from __future__ import annotations

import math
import statistics
import timeit
from typing import Any

from ..errors import SolverError
from ..optimization.problem import Instances, Nlp
from ..optimization.solvers import Answer, Isolated
from .problem import Problem
from .verification import NOT_APPLICABLE

MAX_SOLVES = 5
"""Largest number of solves, whose median is the time."""

EXTRA_SECONDS = 0.3
"""Time for solves after the first one, if that took at most ten times as long."""


def benchmark(problem: Problem, start: str, label: str, solver: Isolated) -> dict[str, Any]:
    """Row of one solver on one problem from one start, as plain values.

    Columns: family, problem, start, solver; reported_status, and status (reported_status, unless
    that is a success and the answer is not finite or violates the constraints); message, the
    solver's own; objective; violation, absolute, and violated_row, its row; stationarity and
    complementarity, relative to the problem's scale; iterations; evaluations; build_seconds;
    solve_seconds, the median of `solves` solves, and time_ratio, the slowest over the fastest;
    objective_scale; gradient_seconds, the time of an evaluation of objective and gradient.
    """
    nlp, instance = problem.nlp, problem.starts[start]
    length, value = instance.scale[0].tolist()
    row: dict[str, Any] = {
        "family": problem.family,
        "problem": problem.name,
        "start": start,
        "solver": label,
    }
    try:
        build, (answer,) = solver.timed_answers(nlp, instance)
    except SolverError as error:
        return row | _no_answer(str(error), value)
    solution = solver.verified(nlp, instance, answer, build)
    times = _solve_times(solver, nlp, instance, answer)
    residuals = solution.residuals
    return row | {
        "reported_status": str(answer.status),
        "status": str(solution.status),
        "message": solution.message,
        "objective": solution.objective,
        "violation": residuals.violation,
        "violated_row": residuals.violated_row,
        "stationarity": residuals.stationarity * length / value,
        "complementarity": residuals.complementarity / value,
        "iterations": int(solution.iterations),
        "evaluations": int(solution.evaluations),
        "build_seconds": build,
        "solve_seconds": statistics.median(times),
        "solves": len(times),
        "time_ratio": max(times) / min(times) if len(times) > 1 and min(times) > 0 else math.nan,
        "objective_scale": value,
        "gradient_seconds": _gradient_seconds(nlp, instance),
    }


def _no_answer(message: str, objective_scale: float) -> dict[str, Any]:
    """Row of a solver that does not support the problem."""
    numbers = ("objective", "violation", "stationarity", "complementarity", "build_seconds")
    return {
        "reported_status": NOT_APPLICABLE,
        "status": NOT_APPLICABLE,
        "message": message,
        **dict.fromkeys((*numbers, "solve_seconds", "time_ratio", "gradient_seconds"), math.nan),
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

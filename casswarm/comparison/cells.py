"""A cell of a comparison: one solver on one problem from one start."""

from __future__ import annotations

import math
import statistics
import time
from typing import Any

import numpy as np

from ..errors import SolverError
from ..optimization.problem import Instances, Nlp
from ..optimization.solvers import Answer, Isolated
from .problems import Problem
from .verification import CANNOT

REPEATS = 5
"""Solves of a cell at the most; its time is their median."""

BUDGET = 0.3
"""Seconds of further solves after the first, if that took at most ten times as long."""


def run_cell(problem: Problem, start: str, label: str, solver: Isolated) -> dict[str, Any]:
    """Row of a cell, as plain values.

    Columns: family, problem, start, solver; claim (the status in the solver's own opinion) and
    status (claim, unless it is a success that is not finite or violates the constraints); words,
    the solver's own; objective; violation, absolute, and the name of the worst row; stationarity
    and complementarity, in units of the problem; iterations; evaluations; build_seconds;
    solve_seconds, the median of `solves` solves, and spread, the slowest over the fastest; unit,
    the objective's; gradient_seconds, the time of an evaluation of objective and gradient.
    """
    nlp, instance = problem.nlp, problem.starts[start]
    length, value = (1.0, 1.0) if instance.scale is None else instance.scale[0].tolist()
    row: dict[str, Any] = {
        "family": problem.family,
        "problem": problem.name,
        "start": start,
        "solver": label,
    }
    try:
        build, (answer,) = solver.timed_answers(nlp, instance)
    except SolverError as error:
        return row | _nothing(str(error), value)
    solution = solver.verified(nlp, instance, answer, build)
    times = _times(solver, nlp, instance, answer)
    residuals = solution.residuals
    return row | {
        "claim": str(answer.status),
        "status": str(solution.status),
        "words": solution.message,
        "objective": solution.objective,
        "violation": residuals.violation,
        "worst": residuals.violated_row,
        "stationarity": residuals.stationarity * length / value,
        "complementarity": residuals.complementarity / value,
        "iterations": int(solution.iterations),
        "evaluations": int(solution.evaluations),
        "build_seconds": build,
        "solve_seconds": statistics.median(times),
        "solves": len(times),
        "spread": max(times) / min(times) if len(times) > 1 and min(times) > 0 else math.nan,
        "unit": value,
        "gradient_seconds": _gradient_seconds(nlp, instance),
    }


def _nothing(words: str, value: float) -> dict[str, Any]:
    numbers = ("objective", "violation", "stationarity", "complementarity", "build_seconds")
    return {
        "claim": CANNOT,
        "status": CANNOT,
        "words": words,
        **dict.fromkeys(numbers, math.nan),
        "worst": "",
        "iterations": 0,
        "evaluations": 0,
        "solve_seconds": math.nan,
        "solves": 0,
        "spread": math.nan,
        "unit": value,
        "gradient_seconds": math.nan,
    }


def _times(solver: Isolated, nlp: Nlp, instance: Instances, answer: Answer) -> list[float]:
    """Seconds of the first solve and, where it was a success and is cheap, of further ones."""
    times = [float(answer.seconds)]
    if not answer.status.success or times[0] > 10 * BUDGET:
        return times
    while len(times) < REPEATS and sum(times[1:]) < BUDGET:
        _, (again,) = solver.timed_answers(nlp, instance)
        if again.status is not answer.status:
            break
        times.append(float(again.seconds))
    return times


def _gradient_seconds(nlp: Nlp, instance: Instances) -> float:
    x, p = instance.x0[0], instance.p[0]
    times = []
    for _ in range(7):
        started = time.perf_counter()
        nlp.gradient(x, p)
        times.append(time.perf_counter() - started)
    return float(np.median(times))

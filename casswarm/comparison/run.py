"""Comparison of solvers: every solver on every problem from every start, each in a process."""

from __future__ import annotations

import math
import os
import platform
import statistics
import sys
import timeit
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import partial
from importlib.metadata import version
from itertools import product
from numbers import Integral
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
from typing_extensions import Unpack

from .._util.checkpoint import Checkpoint, file_name, opened
from .._util.numbers import require_seed
from .._util.parts import part_of
from .._util.progress import reporter
from .._util.settings import SAVED, Execution, SavedKeywords, given_values
from .._util.text import shown
from .._util.user_code import code_hash
from ..errors import ComparisonError, SolverError
from ..nlp.program import Instances, Nlp
from ..nlp.residuals import relative_error
from ..solvers import SOLVERS, Answer, Isolated, Solver, make_solver
from ..solvers import __name__ as solver_room
from ..typing import Progress, Seed
from .families import FAMILIES, make_problems
from .perturbation import ProblemCopy, is_structured, problem_copies
from .problem import Problem
from .result import Comparison, iterate_columns, iterate_table, longest
from .verification import NOT_APPLICABLE, Tolerances, verify

_LIBRARIES = ("casswarm", "casadi", "numpy", "scipy", "numba")


def environment() -> dict[str, dict[str, str | int | None]]:
    """The machine, and the versions of the libraries that solve, as plain values."""
    return {
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "system": platform.platform(),
            "python": platform.python_version(),
        },
        "versions": {name: version(name) for name in _LIBRARIES},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


def warm_up(problems: Sequence[Problem]) -> tuple[Nlp, Instances]:
    """Small problem that each process of a solver solves first, untimed, if it can.

    Where problems have a form that special solvers exploit, it is the first of a registered family,
    so that these solvers take it too; without any, no family is imported.
    """
    if any(map(is_structured, problems)):
        makers = (family.warm_up for family in FAMILIES.values() if family.warm_up is not None)
        for make in makers:
            return make()
    return _two_variables()


def _two_variables() -> tuple[Nlp, Instances]:
    """A convex program in a box and a disc."""
    x = ca.SX.sym("x", 2)
    objective = ca.exp(x[0] - x[1]) + ca.sumsqr(x - 1)
    nlp = Nlp.from_expressions("small", x, ca.SX.sym("p", 0), objective, ca.sumsqr(x))
    bound, limit = np.full((1, 2), 2.0), np.ones((1, 1))
    start, none = np.full((1, 2), 0.1), np.empty((1, 0))
    return nlp, Instances(start, none, -bound, bound, -np.inf * limit, limit)


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
    `casswarm.nlp.residuals.relative_error`; iterations; evaluations; build_seconds;
    solve_seconds, the median of `solves` solves, and time_ratio, the slowest over the fastest;
    objective_scale; gradient_seconds, the time of an evaluation of objective and gradient; and
    iterates, from `casswarm.comparison.result.iterate_columns`, empty if they are not to be
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
    gradient = partial(nlp.gradient, instance.x0[0], instance.p[0])
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
        "gradient_seconds": statistics.median(timeit.repeat(gradient, number=1, repeat=7)),
        "iterates": iterate_columns(problem, start, solver, seconds) if recorded else {},
    }


def _no_answer(message: str, objective_scale: float) -> dict[str, Any]:
    """Row of a solver that does not support the problem."""
    numbers = ("objective", "violation", "stationarity", "complementarity", "relative_error")
    seconds = ("build_seconds", "solve_seconds", "time_ratio", "gradient_seconds")
    return {
        **dict.fromkeys(("reported_status", "status"), NOT_APPLICABLE),
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


DEFAULT = ("guides", "formations")
"""Families that are compared by default."""

TIME_LIMIT = 2.0
"""Default time limit in seconds: several times what Ipopt needs for the largest problem."""

_OWN_FRACTION = 0.9  # of the time limit, so that a solver can stop by itself and report its status


def compare(
    problems: str | Problem | Sequence[str | Problem] = DEFAULT,
    solvers: str | Solver | Sequence[str | Solver] | Mapping[str, str | Solver] | None = None,
    *,
    count: int | None = None,
    copies: int = 0,
    seed: Seed = 0,
    tolerances: Tolerances | None = None,
    record_iterates: bool = True,
    execution: Execution | None = None,
    **plain: Unpack[SavedKeywords],
) -> Comparison:
    """Compare solvers on problems, each solver in a process of its own.

    A solver that raises, hangs or kills its process gets a row that says so, and the comparison
    continues. Every answer is verified in this process by residuals recomputed from the problem. A
    script has to call this under ``if __name__ == "__main__":``.

    Parameters
    ----------
    problems : str, Problem, or sequence of these
        Names of `casswarm.comparison.FAMILIES`, or problems of your own: see `Problem`,
        `read_problems`, and those of a scenario, `formation_problems` and `guide_problems`.
    solvers : str, Solver, sequence of these, or mapping of label to these, optional
        By default all of `casswarm.solvers.SOLVERS` that can run here. A mapping
        compares the same solver with different options.
    count : int, optional
        Number of problems of every kind in a named family; each has its own default.
    copies : int
        Number of perturbed copies of every problem, solved beside the problem itself: other
        initial guesses, orders and units, on which answers should not depend. See
        `casswarm.comparison.perturbation`. The time grows with 1 + copies: none by default, 2 to 5
        for results to be published.
    seed : int
        From 0 to 2^64 - 1. The same seed gives the same problems and copies.
    tolerances : Tolerances, optional
        What counts as solved.
    record_iterates : bool
        Whether each problem (not its copies) is solved once more, untimed, to record the iterates
        of solvers that report them: see `Comparison.convergence`.
    execution, **plain
        Values of `Execution`, in this record or as plain keywords:

        - `time_limit`: seconds for building and solving a problem once. Solvers that have a time
          limit of their own get nine tenths of it, so that they can report their status; the
          process of a solver that takes longer is ended. What a process does only once, such as
          imports and compilation, does not count: every process, and each that replaces it, solves
          a small problem first, untimed.
        - `checkpoint`, a folder in which every finished run is saved, and `if_exists`, which is
          "error", "resume" or "overwrite": what to do with an unfinished comparison in it.
        - `progress`.

    Returns
    -------
    Comparison

    Raises
    ------
    ComparisonError
        An unknown family, solvers or problems of the same name, a time limit or number of copies
        out of range, or no solver that is applicable to any of the problems.
    CheckpointError
        The folder holds a comparison with other inputs, or an unfinished one.
    SolverError
        An unknown solver, or one that cannot be sent to another process.
    ValueError
        A seed out of range.
    TypeError
        A value that is given plainly and in a record, or is none of these.
    """
    values = given_values("compare", execution, plain=plain, time_limit=TIME_LIMIT, **SAVED)
    time_limit, progress, checkpoint, if_exists = values
    seed, progress = require_seed(seed), reporter(progress)
    if not time_limit > 0:
        message = f"time_limit = {shown(time_limit)}; allowed: seconds above 0"
        raise ComparisonError(message, key="time_limit", value=time_limit)
    if not isinstance(copies, Integral) or copies < 0:
        message = f"copies = {shown(copies)}; allowed: whole numbers from 0"
        raise ComparisonError(message, key="copies", value=copies)
    listed = _listed(problems)
    limited = {label: _limited(s, time_limit) for label, s in _solvers(solvers).items()}
    posed = _problems(listed, count, seed, progress)
    inputs = {
        "families": [family for family in listed if isinstance(family, str)],
        "count": count,
        "copies": int(copies),
        "record_iterates": bool(record_iterates),
        "seed": seed,
        "time_limit": time_limit,
        "solvers": {label: repr(solver) for label, solver in limited.items()},
        "solver_code": _code(limited),
        "unavailable": _unavailable(),
        "problems": {problem.name: problem.fingerprint() for problem in posed},
        # times of different machines or versions do not belong in one table
        **environment(),
    }
    tolerances = Tolerances() if tolerances is None else tolerances
    isolated = {label: Isolated(solver, time_limit) for label, solver in limited.items()}
    with ExitStack() as stack:
        for solver in isolated.values():
            stack.callback(solver.close)
        records = stack.enter_context(opened(checkpoint, lambda: inputs, if_exists))
        copied = list(problem_copies(posed, copies, seed))
        copied = [copy for k, copy in enumerate(copied) if part_of(checkpoint).owns(k)]
        rows = _benchmarks(copied, isolated, records, progress, inputs["record_iterates"])
    _require_applicable(rows)
    iterates = iterate_table(rows)
    runs = verify(pd.DataFrame(rows), tolerances)
    table = pd.DataFrame([problem.as_row() for problem in posed])
    return Comparison(runs, table, inputs | {"tolerances": asdict(tolerances)}, iterates)


def _listed(problems: Any) -> list[str | Problem]:
    """The problems one by one; TypeError for what is none, with the function that makes some."""
    single = isinstance(problems, str | Problem) or type(problems).__name__ in _MAKERS
    single |= not isinstance(problems, Iterable)
    listed = [problems] if single else list(problems)
    for problem in listed:
        if not isinstance(problem, str | Problem):
            kind = type(problem).__name__
            advice = _MAKERS.get(kind, "Problem.from_casadi(nlp, ...), or read_problems([path])")
            raise TypeError(
                f"problems: {kind} is no problem; allowed: names of families and Problem; "
                f"call {advice}"
            )
    return listed


_MAKERS = {
    "Opti": "Problem.from_opti(opti)",
    "Scenario": "guide_problems(scenario) or formation_problems(scenario)",
    "Nlp": "Problem(name, family, nlp, {start: instances})",
}
"""What makes problems of objects that are none, by the names of their types."""


def _require_applicable(rows: Sequence[Mapping[str, Any]]) -> None:
    """Raise ComparisonError if no solver could try any problem, with the reason of the first."""
    if all(row["status"] == NOT_APPLICABLE for row in rows):
        first = rows[0]
        raise ComparisonError(
            "none of the solvers is applicable to any of the problems; "
            f"{first['solver']}: {first['message']}",
            solver=first["solver"],
            problem=first["problem"],
        )


def _benchmarks(
    copies: Sequence[ProblemCopy],
    solvers: Mapping[str, Isolated],
    checkpoint: Checkpoint | None,
    progress: Progress | None,
    record_iterates: bool,
) -> list[dict[str, Any]]:
    """Rows of all runs: saved ones, and the others in turn, so that solvers share the noise."""
    runs = [
        (copy, start, label) for copy in copies for start, label in product(copy.starts, solvers)
    ]
    rows: list[dict[str, Any]] = []
    report = progress or (lambda *_: None)
    build_seconds: dict[tuple[str, int], float] = {}  # a solver builds a program once
    first = warm_up([copy.problem for copy in copies])
    for solver in solvers.values():
        solver.warm_up(*first)
    for copy, start, label in runs:
        report("comparing", len(rows), len(runs))
        name = file_name(f"{copy.problem.name}-{copy.number}-{start}-{label}")
        row = None if checkpoint is None else checkpoint.load_json(name)
        if row is None:
            solvers[label].start()
            row = benchmark(copy, start, label, solvers[label], record_iterates)
            key = label, id(copy.nlp)
            row["build_seconds"] = build_seconds.setdefault(key, row["build_seconds"])
            if checkpoint is not None:
                checkpoint.save_json(name, row)
        rows.append(row)
    report("comparing", len(rows), len(runs))
    return rows


def _code(solvers: Mapping[str, Solver]) -> dict[str, str]:
    """Hashes of the files that define solvers of the user's, by label."""
    hashes = {label: code_hash(type(solver)) for label, solver in solvers.items()}
    return {label: value for label, value in hashes.items() if value}


def _unavailable() -> dict[str, str]:
    """Known solvers that cannot run in this installation, and why.

    Those of other rooms only where they are loaded: nothing is imported to find out.
    """
    known = (
        name
        for name, target in SOLVERS.targets.items()
        if target.startswith(f"{solver_room}.") or target.partition(":")[0] in sys.modules
    )
    reasons = {name: SOLVERS[name].unavailable() for name in known}
    return {name: reason for name, reason in reasons.items() if reason}


def _solvers(
    solvers: str | Solver | Sequence[str | Solver] | Mapping[str, str | Solver] | None,
) -> dict[str, Solver]:
    if isinstance(solvers, Mapping):
        return {label: make_solver(solver) for label, solver in solvers.items()}
    if solvers is None:
        solvers = [name for name, solver in SOLVERS.items() if not solver.unavailable()]
    listed = [solvers] if isinstance(solvers, str | Solver) else solvers
    chosen = [make_solver(solver) for solver in listed]
    names = [solver.name for solver in chosen]
    _require_distinct("solver", names, "; give a mapping of labels to solvers")
    return dict(zip(names, chosen, strict=True))


def _limited(solver: Solver, time_limit: float) -> Solver:
    """The same solver, with a time limit of its own that is shorter than that of the process."""
    limit = _OWN_FRACTION * time_limit
    if not solver.capabilities.time_limit or getattr(solver, "time_limit", 0.0) <= limit:
        return solver
    return replace(solver, time_limit=limit)  # type: ignore[type-var]


def _problems(
    families: Sequence[str | Problem], count: int | None, seed: int, progress: Progress | None
) -> list[Problem]:
    posed: list[Problem] = []
    for family in families:
        if isinstance(family, Problem):
            posed.append(family)
        else:
            posed += make_problems(family, count, seed, progress)
    _require_distinct("problem", [problem.name for problem in posed])
    return posed


def _require_distinct(kind: str, names: Sequence[str], advice: str = "") -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        message = f"{kind}s of the same name: {', '.join(repeated)}{advice}"
        raise ComparisonError(message, **{kind: repeated[0]})
    if not names:
        raise ComparisonError(f"no {kind} given; name at least one", key=f"{kind}s")

"""Comparison of solvers: every solver on every problem from every start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from itertools import product
from numbers import Integral
from pathlib import Path
from typing import Any

import pandas as pd

from .._util.progress import reporter
from .._util.seeds import require_seed
from .._util.user_modules import code_hash
from ..errors import ComparisonError
from ..optimization.solvers import SOLVERS, Isolated, Solver, make_solver
from ..studies.checkpoint import Checkpoint, IfExists, file_name
from ..typing import Progress
from .benchmark import benchmark
from .convergence import iterate_table
from .environment import environment
from .perturbation import ProblemCopy, problem_copies
from .problem import Problem
from .problems import make_problems
from .result import Comparison
from .verification import NOT_APPLICABLE, Tolerances, verify
from .warm_up import warm_up

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
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
    tolerances: Tolerances | None = None,
    record_iterates: bool = True,
    checkpoint: str | Path | None = None,
    if_exists: IfExists = "error",
    progress: Progress | bool | None = None,
) -> Comparison:
    """Compare solvers on problems, each solver in a process of its own.

    A solver that raises, hangs or kills its process gets a row that says so, and the comparison
    continues. Every answer is verified in this process by residuals recomputed from the problem. A
    script has to call this under ``if __name__ == "__main__":``.

    Parameters
    ----------
    problems : str, Problem, or sequence of these
        Names of `casswarm.comparison.FAMILIES`, or problems of your own: see `Problem`,
        `formation_problems`, `guide_problems` and `read_problems`.
    solvers : str, Solver, sequence of these, or mapping of label to these, optional
        By default all of `casswarm.optimization.solvers.SOLVERS` that can run here. A mapping
        compares the same solver with different options.
    count : int, optional
        Number of problems of every kind in a named family; each has its own default.
    copies : int
        Number of perturbed copies of every problem, solved beside the problem itself: other
        initial guesses, orders and units, of which answers should not depend. See
        `casswarm.comparison.perturbation`. The time grows with 1 + copies: none by default, 2 to 5
        for results to be published.
    seed : int
        From 0 to 2^64 - 1. The same seed gives the same problems and copies.
    time_limit : float
        Seconds for building and solving a problem once. Solvers that have a time limit of their
        own get nine tenths of it, so that they can report their status; the process of a solver
        that takes longer is ended. What a process does only once, such as imports and compilation,
        does not count: every process, and each that replaces it, solves a small problem first,
        untimed.
    tolerances : Tolerances, optional
        What counts as solved.
    record_iterates : bool
        Whether each problem (not its copies) is solved once more, untimed, to record the iterates
        of solvers that report them: see `Comparison.convergence`.
    checkpoint : path, optional
        Folder in which every finished run is saved.
    if_exists : {"error", "resume", "overwrite"}
        What to do if that folder holds an unfinished comparison.
    progress : Progress or bool, optional
        True for progress bars, or a function: see `Progress`.

    Returns
    -------
    Comparison

    Raises
    ------
    ComparisonError
        An unknown family, solvers or problems of the same name, or no solver that is applicable to
        any of the problems.
    CheckpointError
        The folder holds a comparison with other inputs, or an unfinished one.
    SolverError
        An unknown solver, or one that cannot be sent to another process.
    ValueError
        A seed out of range.
    """
    seed, progress = require_seed(seed), reporter(progress)
    if not time_limit > 0:
        raise ComparisonError(f"time_limit = {time_limit!r}; allowed: above zero")
    if not isinstance(copies, Integral) or copies < 0:
        raise ComparisonError(f"copies = {copies!r}; allowed: whole numbers from 0")
    listed = [problems] if isinstance(problems, str | Problem) else list(problems)
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
    store = nullcontext() if checkpoint is None else Checkpoint(Path(checkpoint), inputs, if_exists)
    try:
        with store as records:
            rows = _benchmarks(
                list(problem_copies(posed, copies, seed)),
                isolated,
                records,
                progress,
                bool(record_iterates),
            )
    finally:
        for solver in isolated.values():
            solver.close()
    _require_applicable(rows)
    iterates = iterate_table(rows)
    return Comparison(
        runs=verify(pd.DataFrame(rows), tolerances),
        problems=pd.DataFrame([problem.as_row() for problem in posed]),
        inputs=inputs | {"tolerances": asdict(tolerances)},
        iterates=iterates,
    )


def _require_applicable(rows: Sequence[Mapping[str, Any]]) -> None:
    """Raise ComparisonError if no solver could try any problem, with the reason of the first."""
    if all(row["status"] == NOT_APPLICABLE for row in rows):
        first = rows[0]
        raise ComparisonError(
            "none of the solvers is applicable to any of the problems; "
            f"{first['solver']}: {first['message']}"
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
    build_seconds: dict[tuple[str, int], float] = {}  # a solver builds a program once
    for solver in solvers.values():
        warm_up(solver)
    for copy, start, label in runs:
        if progress is not None:
            progress("comparing", len(rows), len(runs))
        name = file_name(f"{copy.problem.name}-{copy.number}-{start}-{label}")
        row = None if checkpoint is None else checkpoint.load_json(name)
        if row is None:
            solvers[label].start()
            row = benchmark(copy, start, label, solvers[label], record_iterates)
            row["build_seconds"] = build_seconds.setdefault(
                (label, id(copy.nlp)), row["build_seconds"]
            )
            if checkpoint is not None:
                checkpoint.save_json(name, row)
        rows.append(row)
    if checkpoint is not None:
        checkpoint.finish()
    if progress is not None:
        progress("comparing", len(rows), len(runs))
    return rows


def _code(solvers: Mapping[str, Solver]) -> dict[str, str]:
    """Hashes of the files that define solvers of the user's, by label."""
    hashes = {label: code_hash(type(solver)) for label, solver in solvers.items()}
    return {label: value for label, value in hashes.items() if value}


def _unavailable() -> dict[str, str]:
    """Known solvers that cannot run in this installation, and why."""
    reasons = {name: solver.unavailable() for name, solver in SOLVERS.items()}
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
        raise ComparisonError(f"{kind}s of the same name: {', '.join(repeated)}{advice}")
    if not names:
        raise ComparisonError(f"no {kind} given")

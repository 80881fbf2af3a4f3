"""A comparison of solvers: every solver on every problem from every start, whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from ..errors import ComparisonError
from ..optimization.solvers import SOLVERS, Isolated, Solver, make_solver
from .cells import run_cell
from .journal import Journal, surroundings
from .problems import Problem, make_problems
from .verification import Tolerances, judged, summary

DEFAULT = ("guides", "formations")
"""Families that are compared if none is named."""

SECONDS = 2.0
"""Limit of a solve by default: several times what Ipopt needs for the largest problem."""

_OWN_SHARE = 0.9  # of the limit; with what is left a solver that stops by itself can say so

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Comparison:
    """What comparing solvers gave.

    Parameters
    ----------
    cells : DataFrame
        A row a (problem, start, solver): see `casswarm.comparison.cells.run_cell` and
        `casswarm.comparison.verification.judged`.
    problems : DataFrame
        A row a problem: family, problem, and its traits.
    inputs : dict
        All that made the cells: families, seed, solvers, seconds, machine, versions, and a
        fingerprint of every problem. Plain values.
    tolerances : Tolerances
    """

    cells: pd.DataFrame = field(repr=False)
    problems: pd.DataFrame = field(repr=False)
    inputs: dict[str, Any] = field(repr=False)
    tolerances: Tolerances

    @cached_property
    def summary(self) -> pd.DataFrame:
        """A row a (family, start, solver); see `casswarm.comparison.verification.summary`."""
        return summary(self.cells, float(self.inputs["seconds"]))

    def __str__(self) -> str:
        return self.summary.to_string(index=False)


def compare(
    families: Sequence[str | Problem] = DEFAULT,
    solvers: Sequence[str | Solver] | Mapping[str, str | Solver] | None = None,
    *,
    problems: int | None = None,
    seed: int = 0,
    seconds: float = SECONDS,
    tolerances: Tolerances | None = None,
    folder: str | Path | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Compare solvers on families of problems, each solver in a process of its own.

    A solver that raises, hangs or kills its process gets a row that says so, and the comparison
    goes on. Every answer is judged in this process by residuals recomputed from the problem. In a
    script this needs the guard ``if __name__ == "__main__":``.

    Parameters
    ----------
    families : sequence of str or Problem
        Names of `casswarm.comparison.FAMILIES`, or problems of your own.
    solvers : sequence of str or Solver, or mapping of label to these, optional
        By default all of `casswarm.optimization.solvers.SOLVERS` that can run here. A mapping compares the same
        solver with different options.
    problems : int, optional
        How many of every kind in a family; each has its own default.
    seed : int
        Same seed, same problems.
    seconds : float
        Limit for building and solving a problem once. Solvers that know a limit of time are given
        nine tenths of it as their own, so that they can tell how far they came; the process of a
        solver that takes longer is ended.
    tolerances : Tolerances, optional
        What counts as solved.
    folder : path, optional
        Where every cell is kept as soon as it is finished. Started again with the same folder and
        inputs, a comparison goes on where it ended.
    progress : callable, optional
        Called with the number of finished cells, their total, and what is done next.

    Returns
    -------
    Comparison

    Raises
    ------
    ComparisonError
        An unknown family, solvers or problems of the same name, or a folder of other inputs.
    SolverError
        An unknown solver, or one that cannot be sent to another process.
    """
    if not seconds > 0:
        raise ComparisonError(f"seconds = {seconds!r}; allowed: above zero")
    say = progress or _silent
    chosen = {name: _limited(solver, seconds) for name, solver in _solvers(solvers).items()}
    posed = _problems(families, problems, seed, lambda what: say(0, 0, what))
    inputs = _inputs(families, posed, chosen, problems, seed, seconds)
    journal = Journal(None if folder is None else Path(folder), inputs)
    isolated = {label: Isolated(solver, seconds) for label, solver in chosen.items()}
    try:
        _finish(journal, posed, isolated, say)
    finally:
        for solver in isolated.values():
            solver.close()
    tolerances = Tolerances() if tolerances is None else tolerances
    return Comparison(
        cells=judged(_in_order(journal, posed, list(chosen)), tolerances),
        problems=pd.DataFrame([{"family": p.family, "problem": p.name, **p.traits} for p in posed]),
        inputs=inputs | {"tolerances": asdict(tolerances)},
        tolerances=tolerances,
    )


def _inputs(
    families: Sequence[str | Problem],
    posed: Sequence[Problem],
    solvers: Mapping[str, Solver],
    count: int | None,
    seed: int,
    seconds: float,
) -> dict[str, Any]:
    """All that makes the cells, as plain values."""
    return {
        "families": [family for family in families if isinstance(family, str)],
        "problems_each": count,
        "seed": seed,
        "seconds": seconds,
        "solvers": {label: repr(solver) for label, solver in solvers.items()},
        "absent": _absent(),
        "problems": {problem.name: problem.fingerprint() for problem in posed},
        **surroundings(),
    }


def _silent(done: int, total: int, what: str) -> None:
    """Progress that nobody watches."""


def _finish(
    journal: Journal,
    problems: Sequence[Problem],
    solvers: Mapping[str, Isolated],
    say: Progress,
) -> None:
    """Run the cells that are not in the journal: solvers in turn, so that they share the noise."""
    done = {(row["problem"], row["start"], row["solver"]) for row in journal.rows}
    cells = [
        (problem, start, label)
        for problem in problems
        for start in problem.starts
        for label in solvers
    ]
    builds: dict[tuple[str, int], float] = {}
    for problem, start, label in cells:
        if (problem.name, start, label) in done:
            continue
        say(len(journal.rows), len(cells), f"{problem.name}, {start}, {label}")
        solvers[label].start()
        row = run_cell(problem, start, label, solvers[label])
        # built once for all cells that share a program
        row["build_seconds"] = builds.setdefault((label, id(problem.nlp)), row["build_seconds"])
        journal.add(row)
    say(len(journal.rows), len(cells), "")


def _in_order(journal: Journal, problems: Sequence[Problem], labels: Sequence[str]) -> pd.DataFrame:
    table = pd.DataFrame(journal.rows)
    orders = {"problem": [p.name for p in problems], "solver": list(labels)}
    ranks = {key: {name: i for i, name in enumerate(names)} for key, names in orders.items()}
    starts = {start: i for p in problems for i, start in enumerate(p.starts)}
    key = pd.DataFrame(
        {
            "problem": table["problem"].map(ranks["problem"]),
            "start": table["start"].map(starts),
            "solver": table["solver"].map(ranks["solver"]),
        }
    )
    return table.loc[key.sort_values(["problem", "start", "solver"]).index].reset_index(drop=True)


def _absent() -> dict[str, str]:
    """Known solvers that cannot run in this installation, and why."""
    reasons = {name: getattr(kind, "unavailable", lambda: "")() for name, kind in SOLVERS.items()}
    return {name: reason for name, reason in reasons.items() if reason}


def _solvers(
    solvers: Sequence[str | Solver] | Mapping[str, str | Solver] | None,
) -> dict[str, Solver]:
    if isinstance(solvers, (str, Solver)):
        raise ComparisonError(f"solvers must be a list; for a single one give [{solvers!r}]")
    if isinstance(solvers, Mapping):
        return {label: make_solver(solver) for label, solver in solvers.items()}
    absent = _absent() if solvers is None else {}
    names_or_solvers = [s for s in SOLVERS if s not in absent] if solvers is None else solvers
    made = [make_solver(solver) for solver in names_or_solvers]
    names = [solver.name for solver in made]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated or not names:
        raise ComparisonError(
            f"solvers of the same name: {', '.join(repeated)}; give a mapping of labels to solvers"
            if repeated
            else "no solver given"
        )
    return dict(zip(names, made, strict=True))


def _limited(solver: Solver, seconds: float) -> Solver:
    """The same solver, but for its own limit of time where that is longer."""
    own, most = getattr(solver, "time_limit", 0.0), _OWN_SHARE * seconds
    if not solver.capabilities.time_limit or own <= most:
        return solver
    return replace(solver, time_limit=most)  # type: ignore[type-var]


def _problems(
    families: Sequence[str | Problem],
    count: int | None,
    seed: int,
    say: Callable[[str], None],
) -> list[Problem]:
    if isinstance(families, (str, Problem)):
        raise ComparisonError(f"families must be a list; for a single one give [{families!r}]")
    posed: list[Problem] = []
    for family in families:
        posed += (
            [family] if isinstance(family, Problem) else make_problems(family, count, seed, say)
        )
    names = [problem.name for problem in posed]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated or not names:
        raise ComparisonError(
            f"problems of the same name: {', '.join(repeated)}" if repeated else "no family given"
        )
    return posed

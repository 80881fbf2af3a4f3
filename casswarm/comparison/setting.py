"""The head of a report: what was solved, by what, on what machine, and what counts as solved."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from ..optimization.solvers import SOLVERS
from .problems import FAMILIES
from .rendering import Block, Heading, Table, Text
from .run import Comparison
from .verification import SHIFT, not_taken


def setting(comparison: Comparison) -> Iterator[Block]:
    """What was solved, by what, and where."""
    inputs, problems = comparison.inputs, comparison.problems
    machine, versions = inputs["machine"], inputs["versions"]
    yield Heading("A comparison of solvers", 1)
    yield Text(
        f"{len(problems)} problems, {len(inputs['solvers'])} solvers, "
        f"{len(comparison.cells)} cells: every solver on every problem from every start, each "
        f"solver in a process of its own, at most {inputs['seconds']:g} s a solve. Seed "
        f"{inputs['seed']}. On {machine['processor']}, {machine['cores']} cores, "
        f"{machine['system']}, Python {machine['python']}; "
        + ", ".join(f"{name} {number}" for name, number in versions.items())
        + "."
    )
    yield Heading("What was solved")
    rows = []
    for family, part in problems.groupby("family", sort=False):
        known = FAMILIES.get(str(family))
        rows.append(
            {
                "family": family,
                "problems": len(part),
                "variables": _range(part, "variables"),
                "constraints": _range(part, "constraints"),
                "what they are": known[2] if known else "given by the user",
            }
        )
    yield Table(pd.DataFrame(rows))
    yield Text(
        "The problems are those that planning and simulation pose to their solver on random "
        "scenarios. Guides start cold from the straight line at constant speed, and warm from a "
        "local solution with noise added. Formations are states of simulated runs; they start cold "
        "from zero velocities, and warm from those of the step before, made feasible. Cold and "
        "warm starts are never mixed in a table."
    )
    yield Heading("By what")
    rows = [
        {"solver": name, "what it is": _summary(name), "options": options}
        for name, options in inputs["solvers"].items()
    ]
    yield Table(pd.DataFrame(rows))
    for solver, reason in inputs["absent"].items():
        yield Text(f"{solver} cannot run here: {reason}.")
    for row in not_taken(comparison.cells).to_dict("records"):
        yield Text(
            f"{row['solver']} takes no part in {row['cells']} cells of {row['family']}: "
            f"{row['reason']}. That is no failure; a solver that can take none of a family is left "
            "out of its tables and profiles."
        )


def rules(comparison: Comparison) -> Iterator[Block]:
    """What counts as solved, how time is measured, and how much it scatters."""
    t = comparison.tolerances
    spread = comparison.cells["spread"].dropna()
    noise = (
        f" Repeated solves of a cell differ by a factor of {spread.median():.2f} in the median and "
        f"of more than {spread.quantile(0.9):.2f} in a tenth of the cells: smaller differences "
        "between solvers mean nothing."
        if len(spread)
        else ""
    )
    yield Heading("What counts as solved")
    yield Text(
        "A solver has solved a problem if it says so and it is true. It is true if the residuals, "
        "recomputed from the problem for all solvers alike, are small enough: violation of any "
        f"constraint at most {t.violation:g}, stationarity at most {t.stationarity:g} and "
        f"complementarity at most {t.complementarity:g} in the problem's units. It has found the "
        "best known if, moreover, its objective is within a relative gap of "
        f"{t.objective:g} of the least objective of any feasible answer, from whatever solver and "
        "start. Best known is not proven best. Times are medians of up to five solves, without "
        "building; their means are shifted geometric means with a shift of "
        f"{1e3 * SHIFT:g} ms, in which a failure counts as the limit of "
        f"{comparison.inputs['seconds']:g} s.{noise} Iterations and evaluations are the solvers' "
        "own counts, medians over what they solved; empty where they tell none."
    )


def _summary(name: str) -> str:
    return SOLVERS[name].summary if name in SOLVERS else "the user's"


def _range(part: pd.DataFrame, column: str) -> str:
    if column not in part or part[column].isna().all():
        return ""
    low, high = int(part[column].min()), int(part[column].max())
    return f"{low}" if low == high else f"{low} to {high}"

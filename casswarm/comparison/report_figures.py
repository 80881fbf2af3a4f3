"""Figures of the report of a comparison, drawn on demand.

One of performance profiles, with a panel for every family and start, and for each of these one of
its ranking, profiles, bands, pairs of solvers, and convergence on a typical problem.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from .._util.text import counted
from .charts import band_chart, gap_chart, profile_chart, ranking_chart, win_chart
from .convergence import typical_problem
from .profiles import (
    data_profile,
    pairwise_wins,
    performance_bands,
    performance_profile,
    quality_profile,
)
from .ranking import sampling_units
from .result import Comparison
from .verification import by_solver, costs


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure that is drawn, in the theme of the context, when it is called.

    Parameters
    ----------
    title : str
        Its title, which describes it where it cannot be shown.
    draw : callable
        Returns the figure, given `arguments` and then the keywords title and order.
    arguments : tuple
    order : tuple of str
        All solvers, so that each has the same style in all figures.
    """

    title: str
    draw: Callable[..., Figure]
    arguments: tuple[Any, ...]
    order: tuple[str, ...] = ()

    def __call__(self) -> Figure:
        """The figure."""
        return self.draw(*self.arguments, title=self.title, order=self.order)


class _Panel(NamedTuple):
    """A profile, and what its axes show."""

    name: str
    profile: pd.DataFrame
    xlabel: str
    ylabel: str = "fraction of problems"


def figures(comparison: Comparison) -> dict[str, Drawing]:
    """The report's figures by name."""
    drawings = {
        name: drawing
        for family, start in groups(comparison)
        for name, drawing in _group_figures(comparison, family, start)
    }
    return {"overview": overview(comparison), **drawings}


def overview(comparison: Comparison) -> Drawing:
    """Performance profiles of solving, a panel for every family and start."""
    panels = tuple(
        _Panel(
            f"{family}, {start} start",
            performance_profile(costs(comparison.runs, family, start, "solve_seconds")),
            _FACTOR,
        )
        for family, start in groups(comparison)
    )
    order = tuple(comparison.inputs["solvers"])
    return Drawing("Performance profiles of solve time", draw_profiles, (panels,), order)


def groups(comparison: Comparison) -> Iterator[tuple[str, str]]:
    """Families and starts, in order."""
    pairs = comparison.summary[["family", "start"]].drop_duplicates()
    yield from pairs.itertuples(index=False, name=None)


def tag(family: str, start: str) -> str:
    """End of the names of a group's figures."""
    return re.sub(r"[^\w.-]", "-", f"{family}-{start}")


def _group_figures(
    comparison: Comparison, family: str, start: str
) -> Iterator[tuple[str, Drawing]]:
    """Figures of a family and a kind of start, each with its name."""
    runs, order, end = comparison.runs, tuple(comparison.inputs["solvers"]), tag(family, start)
    times = costs(runs, family, start, "solve_seconds")
    group = _title(family, start, times)
    ranking = comparison.ranking
    ranking = ranking[(ranking["family"] == family) & (ranking["start"] == start)]
    yield f"ranking-{end}", Drawing(f"{group}: ranks", ranking_chart, (ranking,), order)
    panels = tuple(_panels(comparison, family, start))
    yield f"profiles-{end}", Drawing(f"{group}: profiles", draw_profiles, (panels,), order)
    units = times.set_axis(sampling_units(family, times.index))
    bands = performance_profile(times), performance_bands(units), _FACTOR
    heading = f"{group}: performance profiles with 95 % bands"
    yield f"bands-{end}", Drawing(heading, band_chart, bands, order)
    if len(times.columns) > 2:  # of two, the profiles say it
        heading = f"{group}: fraction of problems on which a solver is faster"
        yield f"wins-{end}", Drawing(heading, _draw_wins, (pairwise_wins(times),))
    problem = typical_problem(comparison, family, start)
    if problem is not None:
        yield f"convergence-{end}", convergence_drawing(comparison, problem, start)


def convergence_drawing(comparison: Comparison, problem: str, start: str) -> Drawing:
    """Figure of the convergence on a problem."""
    history = comparison.convergence(problem, start)
    return Drawing(
        f"{problem}, {start} start: convergence",
        draw_gaps,
        (history.iterates, tuple(history.missing)),
        history.solvers,
    )


_FACTOR = "factor of the fastest solver's time"


def _panels(comparison: Comparison, family: str, start: str) -> Iterator[_Panel]:
    runs, tolerances = comparison.runs, comparison.tolerances
    best = costs(runs, family, start, "solve_seconds", "best_known")
    exact = costs(runs, family, start, "solve_seconds", "high_accuracy")
    feasible = 1e3 * costs(runs, family, start, "solve_seconds", "feasible")
    quality = quality_profile(feasible, by_solver(runs, family, start, "quality"))
    gap = f"{tolerances.objective:g}"
    name = f"solved, within {gap} of the best known objective"
    yield _Panel(name, performance_profile(best), _FACTOR)
    name = f"solved to high accuracy, {tolerances.high_accuracy:g}"
    yield _Panel(name, performance_profile(exact), _FACTOR)
    name = "quality within a time"
    yield _Panel(name, quality, "time in ms", "mean quality")
    name = "solved within a number of evaluations"
    budget = data_profile(costs(runs, family, start, "evaluations"))
    yield _Panel(name, budget, "evaluations of the objective")


def draw_profiles(panels: Sequence[_Panel], title: str, order: Sequence[str]) -> Figure:
    """All profiles of a group."""
    return profile_chart(
        {panel.name: panel.profile for panel in panels},
        [panel.xlabel for panel in panels],
        title,
        order,
        [panel.ylabel for panel in panels],
    )


def draw_gaps(
    iterates: pd.DataFrame, missing: Sequence[str], title: str, order: Sequence[str]
) -> Figure:
    """Convergence on a problem."""
    return gap_chart(iterates, title, order, missing)


def _draw_wins(wins: pd.DataFrame, title: str, order: Sequence[str]) -> Figure:  # noqa: ARG001
    return win_chart(wins, title)


def _title(family: str, start: str, times: pd.DataFrame) -> str:
    number = times.index.nunique()
    copies = len(times) // number - 1
    text = f"{family}, {start} start, {counted(number, 'problem')}"
    return f"{text} and {counted(copies, 'copy', 'copies')} of each" if copies else text

"""Figures of the report of a comparison: rankings, profiles with bands, pairs."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pandas as pd
from matplotlib.figure import Figure

from .._util.text import counted
from ..figures import band_chart, pair_chart, profile_chart, ranking_chart, win_chart
from .profiles import (
    data_bands,
    data_profile,
    pairwise_profiles,
    pairwise_wins,
    performance_bands,
    performance_profile,
    quality_profile,
)
from .result import Comparison
from .verification import by_solver, costs


def figures(comparison: Comparison) -> dict[str, Figure]:
    """The report's figures by name."""
    return {
        name: figure
        for family, start in groups(comparison)
        for name, figure in _group_figures(comparison, family, start)
    }


def groups(comparison: Comparison) -> Iterator[tuple[str, str]]:
    """Families and starts, in order."""
    pairs = comparison.summary[["family", "start"]].drop_duplicates()
    yield from pairs.itertuples(index=False, name=None)


def tag(family: str, start: str) -> str:
    """End of the names of a group's figures."""
    return re.sub(r"[^\w.-]", "-", f"{family}-{start}")


def _group_figures(comparison: Comparison, family: str, start: str) -> Iterator[tuple[str, Figure]]:
    runs, order, end = comparison.runs, list(comparison.inputs["solvers"]), tag(family, start)
    times = costs(runs, family, start, "solve_seconds")
    title = _title(family, start, times)
    ranking = comparison.ranking
    ranking = ranking[(ranking["family"] == family) & (ranking["start"] == start)]
    yield f"ranking-{end}", ranking_chart(ranking, f"{title}: ranks", order)

    best_times = costs(runs, family, start, "solve_seconds", "best_known")
    gap = f"{comparison.tolerances.objective:g}"
    profile = performance_profile(times)
    profiles = {
        "solved (reported and verified)": profile,
        f"solved, and within {gap} of the best known objective": performance_profile(best_times),
    }
    label = "factor of the fastest solver's time"
    heading = f"{title}: performance profiles of solve time"
    yield f"profile-{end}", profile_chart(profiles, label, heading, order)
    heading = f"{title}: performance profiles with 95 % bands"
    bands = performance_bands(times)
    yield f"profile-bands-{end}", band_chart(profile, bands, label, heading, order)

    units = _gradient_seconds(runs, family, start).reindex(times.index).to_numpy()
    data = data_profile(times, units)
    unit = "time, in evaluations of objective and gradient"
    profiles = {
        "evaluations of the objective": data_profile(costs(runs, family, start, "evaluations")),
        unit: data,
    }
    yield f"data-{end}", profile_chart(profiles, "budget", f"{title}: data profiles", order)
    heading = f"{title}: data profiles with 95 % bands"
    yield f"data-bands-{end}", band_chart(data, data_bands(times, units), unit, heading, order)

    feasible = 1e3 * costs(runs, family, start, "solve_seconds", "feasible")
    profiles = {
        "quality of the objective": quality_profile(
            feasible, by_solver(runs, family, start, "quality")
        ),
        f"solved, and within {gap} of the best known objective": data_profile(1e3 * best_times),
    }
    heading = f"{title}: objective reached within a time"
    yield (
        f"quality-{end}",
        profile_chart(profiles, "time in ms", heading, order, "mean over the problems"),
    )

    if len(times.columns) > 1:
        best = str(ranking["solver"].iloc[0])
        pairs = {pair: p for pair, p in pairwise_profiles(times).items() if best in pair}
        yield f"pairs-{end}", pair_chart(pairs, f"{title}: {best} and every other solver", order)
        heading = f"{title}: fraction of problems on which a solver is faster"
        yield f"wins-{end}", win_chart(pairwise_wins(times), heading)


def _title(family: str, start: str, times: pd.DataFrame) -> str:
    number = times.index.nunique()
    copies = len(times) // number - 1
    text = f"{family}, {start} start, {counted(number, 'problem')}"
    return f"{text} and {counted(copies, 'copy', 'copies')} of each" if copies else text


def _gradient_seconds(runs: pd.DataFrame, family: str, start: str) -> pd.Series:
    """Time of an evaluation of objective and gradient of every problem."""
    group = runs[(runs["family"] == family) & (runs["start"] == start)]
    return group.groupby("problem")["gradient_seconds"].median()

"""Everything that `casswarm reproduce` makes: tables and figures by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from .._util.documents import render
from .._util.numbers import require_seed, rounded_up
from .._util.text import shown
from ..chain.monte_carlo import RunTrajectory
from ..figures import (
    comparison_map,
    convergence_chart,
    infeasible_chart,
    sensitivity_chart,
    success_chart,
    swarm_map,
    table_2_chart,
)
from ..guide.guide import Guide
from ..guide.plan import plan
from ..policies import member_guides
from ..results.catalogue import FigureCatalogue
from ..scenario import Scenario, load_scenario
from ..studies.simulation import simulate
from .gradient_convergence import condensed, formation_convergence, guide_convergence
from .paper_tables import (
    METHOD,
    PAPER_RUNS,
    PAPER_SUCCESS,
    READING_RUNS,
    SENSITIVITY_RUNS,
    Report,
    beyond,
    geometry,
    infeasibility_cost,
    infeasible_steps,
    interpretations,
    paper_interval,
    readings,
    sensitivity,
    table_1,
    table_2,
    variants,
)

RUNS = 2000
"""Runs that sample what the exact distributions of Table II leave open."""

TABLES = {
    "table-1": "Table I: the parameters, as the paper states and as casswarm uses them",
    "geometry": "Members, radars and target: a calibration, not the paper's figure",
    "table-2": "Table II: success probabilities in scenario I",
    "sensitivity": "Table II after small changes of the geometry",
    "guide-convergence": "The paper's projected gradient on its guide problem",
    "formation-convergence": "The paper's projected gradient on its formation problems",
    "infeasible": "Members with an empty constraint set along Ipopt's guide, step by step",
    "empty-sets": "Cost of empty constraint sets along Ipopt's guide",
    "beyond": "Success with other guides, in other scenarios, and in scenario II",
    "readings": "Table II by the paper's method, under other readings of the paper",
    "interpretations": "Errors and ambiguities of the paper, and casswarm's interpretation",
}
"""Names of the tables, each with its title."""

FIGURES = (
    "figure-1",
    "figure-2",
    "figure-3",
    "figure-4",
    "table-2",
    "sensitivity",
    "convergence",
    "infeasible",
    "beyond",
)
"""Names of the figures; the first four are the paper's."""

DRAWN = "figures"
"""Name of the paper's own figures in `only`."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Reproduction of the paper.

    Parameters
    ----------
    tables : mapping of name to DataFrame
        The requested ones of `TABLES`.
    figures : mapping of name to function
        The requested ones of `FIGURES`; each draws its figure in the theme of its context.
    guide : Guide
        Ipopt's local guide of scenario I, for comparison with the paper's method.
    runs, seed : int
        Of the runs in Table II.
    """

    tables: Mapping[str, pd.DataFrame]
    figures: FigureCatalogue
    guide: Guide
    runs: int
    seed: int

    @property
    def complete(self) -> bool:
        """True if all tables and figures are present."""
        return {*self.tables} == {*TABLES} and {*self.figures} == {*FIGURES}


def reproduce(
    runs: int = RUNS,
    seed: int = 0,
    progress: Report | None = None,
    only: Collection[str] | None = None,
) -> Reproduction:
    """Reproduce the paper's tables and figures, and results beyond them, in a few minutes.

    Parameters
    ----------
    runs : int
        Number of runs that sample what exact distributions leave open in Table II.
    seed : int
        Of all random numbers, from 0 to 2^64 - 1.
    progress : callable, optional
        Called with the name of the current task.
    only : collection of str, optional
        Some of `TABLES`, and ``"figures"`` for the paper's own; by default everything. The other
        figures are drawn with their tables.

    Returns
    -------
    Reproduction
        The same numbers every time, on one machine; on others up to the last digits of a solve.

    Raises
    ------
    ValueError
        Too few runs, a seed out of range, or an unknown name in `only`.
    """
    seed = require_seed(seed)
    if not (isinstance(runs, int) and runs > 0):
        raise ValueError(f"runs = {shown(runs)}; allowed: whole numbers from 1")
    unknown = sorted({*(only or ())} - {*TABLES, DRAWN})
    if unknown:
        raise ValueError(f"only = {shown(unknown[0])}; allowed: {', '.join([*TABLES, DRAWN])}")
    report: Report = progress or (lambda _: None)
    first, second = load_scenario("paper-1"), load_scenario("paper-2")
    guide = plan(first, certify=False)
    makers: dict[str, Callable[[], pd.DataFrame]] = {
        "table-1": lambda: table_1(second),
        "geometry": lambda: geometry(first),
        "table-2": lambda: table_2(first, guide, runs, seed),
        "sensitivity": lambda: sensitivity(first, report, seed),
        "guide-convergence": lambda: guide_convergence(first),
        "formation-convergence": lambda: _formations(first, second, guide, report),
        "infeasible": lambda: infeasible_steps(first, guide, seed=seed),
        "empty-sets": lambda: infeasibility_cost(first, report),
        "beyond": lambda: beyond(variants(), report, seed=seed),
        "readings": lambda: readings(first, report, seed),
        "interpretations": interpretations,
    }
    tables = {}
    for name in TABLES:
        if only is None or name in only:
            report(name)
            tables[name] = makers[name]()
    figures: FigureCatalogue = {}
    if only is None or DRAWN in only:
        report(DRAWN)
        figures = paper_figures(first, second, plan(first, METHOD, certify=False), seed)
    return Reproduction(tables, figures | _charts(tables, guide), guide, runs, seed)


def _formations(first: Scenario, second: Scenario, guide: Guide, report: Report) -> pd.DataFrame:
    tables = {}
    for number, scenario in (("I", first), ("II", second)):
        for policy in ("leader", "constrained"):
            report(f"projected gradient: {policy}, scenario {number}")
            tables[f"{policy}, {number}"] = formation_convergence(scenario, policy, guide)
    return condensed(tables)


def paper_figures(
    first: Scenario, second: Scenario, guide: Guide, seed: int = 0
) -> FigureCatalogue:
    """The paper's Figures 1 to 4, by its method: maps of a run each, and the naive guides."""
    runs = {
        "figure-1": (first, "leader", "leader protection, scenario I"),
        "figure-2": (first, "constrained", "constrained trajectory, scenario I"),
        "figure-3": (second, "leader", "leader protection, scenario II"),
    }
    figures: FigureCatalogue = {}
    for name, (scenario, policy, label) in runs.items():
        number, trajectory = representative_run(scenario, policy, guide, seed)
        title, corridors = f"{label}, run {number}", policy == "constrained"
        figures[name] = partial(swarm_map, scenario, trajectory, guide, title, corridors=corridors)
    title = "naive, every member's own guide: its survival alone and arrival"
    guides = {f"member {k}": own for k, own in enumerate(member_guides(first, guide))}
    figures["figure-4"] = partial(comparison_map, first, guides, title)
    return figures


def representative_run(
    scenario: Scenario, policy: str, guide: Guide, seed: int = 0, runs: int = 200
) -> tuple[int, RunTrajectory]:
    """The first run by the paper's method that succeeds and loses two members, as in its figures.

    If there is none among `runs`, the first that succeeds, or else the first. Also its number.
    """
    study = simulate(
        scenario, policy, runs, seed, guide=guide, solver=METHOD, save_trajectories=runs
    )
    success = study.runs["success"].to_numpy(bool)
    two_lost = study.runs["survivors"].to_numpy() == scenario.n - 2
    number = int([*np.flatnonzero(success & two_lost), *np.flatnonzero(success), 0][0])
    return number, study.trajectories[policy][number]


def _charts(tables: Mapping[str, pd.DataFrame], guide: Guide) -> FigureCatalogue:
    """The figures of the requested tables."""

    def convergence() -> Figure:
        best = plan(load_scenario("paper-1"), search="global", certify=False)
        return convergence_chart(
            tables["guide-convergence"],
            tables["formation-convergence"],
            {"Ipopt, from the straight line": guide.survival, "global search": best.survival},
        )

    needs = {"convergence": ("guide-convergence", "formation-convergence")}
    paper = {policy: paper_interval(policy) for policy in PAPER_SUCCESS}
    title = "success with other guides and in other scenarios"
    charts: FigureCatalogue = {
        "table-2": lambda: table_2_chart(tables["table-2"]),
        "sensitivity": lambda: sensitivity_chart(tables["sensitivity"], paper),
        "convergence": convergence,
        "infeasible": lambda: infeasible_chart(tables["infeasible"]),
        "beyond": lambda: success_chart(tables["beyond"], title),
    }
    return {
        name: chart for name, chart in charts.items() if {*needs.get(name, (name,))} <= {*tables}
    }


# --- README, and tables as text


def page(reproduction: Reproduction, suffix: str = "png") -> str:
    """Markdown text that shows every table and figure with its caption.

    Figures are links to files NAME.SUFFIX in its folder.
    """
    tables = reproduction.tables
    paths = tables["guide-convergence"].groupby("steps")
    within = tables["table-2"][["method_within", "exact_within"]].sum()
    last = tables["formation-convergence"].groupby(["problems", "steps"], sort=False).tail(1)
    columns = dict.fromkeys(("gap_median", "gap_largest"), "{:.2g}")
    columns |= dict.fromkeys(("residual_median", "residual_largest"), "{:.1g}")
    changes = tables["sensitivity"]
    changes = changes[changes["solver"] == METHOD]
    return render(
        "reproduction.md",
        titles=TABLES,
        figure=lambda name, caption: f"![{name}]({name}.{suffix})\n\n*{caption}*",
        paper_runs=PAPER_RUNS,
        table_1=table_for_people(reproduction, "table-1"),
        geometry=_formatted(tables["geometry"], {"x": "{:g}", "y": "{:g}"}),
        within=within.to_dict(),
        policies=len(tables["table-2"]),
        table_2=table_for_people(reproduction, "table-2"),
        sensitivity_runs=SENSITIVITY_RUNS,
        inside=int((changes["within"] == len(PAPER_SUCCESS)).sum()),
        changes=len(changes),
        guide_iterations=f"{paths['iteration'].max().iloc[0]:.0f}",
        guide_survival=paths["survival"].max().map("{:.2g}".format).to_dict(),
        ipopt_survival=f"{reproduction.guide.survival:.2g}",
        convergence=_formatted(last, columns),
        empty_sets=table_for_people(reproduction, "empty-sets"),
        beyond=_with_success_bounds(_formatted(tables["beyond"], {"guide_survival": "{:.4f}"})),
        interpretations=tables["interpretations"],
        readings=table_for_people(reproduction, "readings"),
        reading_runs=READING_RUNS,
    )


def table_for_people(reproduction: Reproduction, name: str) -> pd.DataFrame:
    """A table with its intervals and bounds as text."""
    table = reproduction.tables[name]
    if name == "table-1":
        return _formatted(table, {"paper": "{:g}", "casswarm": "{:g}"})
    if name == "table-2":
        return table_2_text(table)
    if name == "readings":
        return readings_text(table)
    return _with_success_bounds(table) if "success_low" in table else table


def bounds_text(low: float, high: float) -> str:
    """Bounds to four digits, rounded outward so that they remain bounds."""
    slack = 1e-9  # bounds of four digits are not changed
    return f"{math.floor(1e4 * low + slack) / 1e4:.4f} to {rounded_up(high - slack):.4f}"


def table_2_text(table: pd.DataFrame) -> pd.DataFrame:
    """Table II for people: numbers with their intervals as text."""
    return pd.DataFrame(
        {
            "policy": row["policy"],
            f"paper, {PAPER_RUNS} runs": _with_interval(row, "paper"),
            f"its method, {PAPER_RUNS} runs": _with_interval(row, f"runs_{PAPER_RUNS}"),
            "its method": f"{_bounds_of(row, 'method')} ({row['method_kind']})",
            "Ipopt, proven": _bounds_of(row, "exact"),
        }
        for row in table.to_dict("records")
    )


def readings_text(table: pd.DataFrame) -> pd.DataFrame:
    """Table II under each reading for people: numbers with their intervals as text."""
    shown = table[["location", "question", "answer"]].copy()
    shown["guide survives"] = table["guide_survival"].map("{:.4f}".format)
    for policy in PAPER_SUCCESS:
        shown[policy] = [
            "" if math.isnan(row[policy]) else _with_interval(row, policy, digits=3)
            for row in table.to_dict("records")
        ]
    return shown.assign(within=table["within"])


def _bounds_of(row: Mapping[Any, float], name: str) -> str:
    return bounds_text(row[f"{name}_low"], row[f"{name}_high"])


def _with_interval(row: Mapping[Any, float], name: str, digits: int = 2) -> str:
    low, high, ends = row[f"{name}_low"], row[f"{name}_high"], max(3, digits)
    return f"{row[name]:.{digits}f} ({low:.{ends}f} to {high:.{ends}f})"


def _with_success_bounds(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its bounds of success as one column of text."""
    bounds = zip(table["success_low"], table["success_high"], strict=True)
    success = [bounds_text(low, high) for low, high in bounds]
    shown = table.assign(success_low=success).rename(columns={"success_low": "success"})
    return shown.drop(columns="success_high")


def _formatted(table: pd.DataFrame, formats: Mapping[str, str]) -> pd.DataFrame:
    """The table with columns written in the given formats."""
    return table.assign(**{name: table[name].map(form.format) for name, form in formats.items()})

"""Everything that `casswarm reproduce` makes: tables and figures by name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ..chain.confidence import wilson
from ..chain.trajectories import RunTrajectory
from ..figures import (
    comparison_map,
    convergence_chart,
    infeasible_chart,
    sensitivity_chart,
    success_chart,
    swarm_map,
    table_2_chart,
)
from ..planning.guide import Guide
from ..planning.plan import plan
from ..policies import member_guides
from ..results.catalogue import FigureCatalogue
from ..scenario import Scenario, load_scenario
from ..studies.simulation import simulate
from .convergence import condensed, formation_convergence, guide_convergence
from .infeasibility import cost, shortfall_steps
from .paper import PAPER_RUNS, PAPER_SUCCESS, geometry, readings, table_1
from .success import Tell, beyond, sensitivity, table_2, variants

RUNS = 10_000
"""Runs of every policy in Table II."""

TABLES = {
    "table-1": "Table I: the parameters, as the paper states and as casswarm uses them",
    "geometry": "Members, radars and target: a calibration, not the paper's figure",
    "table-2": "Table II: success probabilities in scenario I",
    "sensitivity": "Table II where the geometry is moved a little",
    "guide-convergence": "The paper's projected gradient on its guide problem",
    "formation-convergence": "The paper's projected gradient on its formation problems",
    "infeasible": "Members whose constraint set is empty, step by step",
    "empty-sets": "What empty constraint sets cost",
    "beyond": "Success with other guides, in other scenarios, and in scenario II",
    "readings": "Where the paper slips or is silent, and casswarm's reading",
}
"""Names of the tables, each with what it holds."""

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
"""What stands for the paper's own figures where only some things are made."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The paper reproduced.

    Parameters
    ----------
    tables : mapping of name to DataFrame
        Of `TABLES`, those that were asked for.
    figures : mapping of name to function
        Of `FIGURES`, likewise; each draws its figure in the look of its context.
    guide : Guide
        The local guide of scenario I, which the paper's policies follow.
    runs, seed : int
        Of the larger simulation of Table II.
    """

    tables: Mapping[str, pd.DataFrame]
    figures: FigureCatalogue
    guide: Guide
    runs: int
    seed: int

    @property
    def complete(self) -> bool:
        """Whether everything was made."""
        return {*self.tables} == {*TABLES} and {*self.figures} == {*FIGURES}


def reproduce(
    runs: int = RUNS,
    seed: int = 0,
    progress: Tell | None = None,
    only: Collection[str] | None = None,
) -> Reproduction:
    """Reproduce the paper's tables and figures, and what goes beyond them, in a few minutes.

    Parameters
    ----------
    runs : int
        Of every policy in the larger simulation of Table II, above 50.
    seed : int
        Of all random numbers.
    progress : callable, optional
        Called with what is being made.
    only : collection of str, optional
        Some of `TABLES`, and ``"figures"`` for the paper's own; by default everything. The other
        figures are drawn where their tables are made.

    Returns
    -------
    Reproduction
        The same numbers every time, on one machine; on others up to the last digits of a solve.

    Raises
    ------
    ValueError
        Too few runs, or an unknown name in `only`.
    """
    if not (isinstance(runs, int) and runs > PAPER_RUNS):
        raise ValueError(f"runs = {runs!r}; allowed: whole numbers above {PAPER_RUNS}")
    unknown = sorted({*(only or ())} - {*TABLES, DRAWN})
    if unknown:
        raise ValueError(f"only = {unknown[0]!r}; allowed: {', '.join([*TABLES, DRAWN])}")
    tell: Tell = progress or (lambda _: None)
    first, second = load_scenario("paper-1"), load_scenario("paper-2")
    guide = plan(first, certify=False)
    makers: dict[str, Callable[[], pd.DataFrame]] = {
        "table-1": lambda: table_1(second),
        "geometry": lambda: geometry(first),
        "table-2": lambda: table_2(first, guide, runs, seed),
        "sensitivity": lambda: sensitivity(first, tell),
        "guide-convergence": lambda: guide_convergence(first),
        "formation-convergence": lambda: _formations(first, second, guide, tell),
        "infeasible": lambda: shortfall_steps(first, guide, seed=seed),
        "empty-sets": lambda: cost(first, tell),
        "beyond": lambda: beyond(variants(), tell, seed=seed),
        "readings": readings,
    }
    tables = {}
    for name in TABLES:
        if only is None or name in only:
            tell(name)
            tables[name] = makers[name]()
    figures: FigureCatalogue = {}
    if only is None or DRAWN in only:
        tell(DRAWN)
        figures = paper_figures(first, second, guide, seed)
    return Reproduction(tables, figures | _charts(tables, guide, runs), guide, runs, seed)


def _formations(first: Scenario, second: Scenario, guide: Guide, tell: Tell) -> pd.DataFrame:
    tables = {}
    for number, scenario in (("I", first), ("II", second)):
        for policy in ("leader", "constrained"):
            tell(f"projected gradient: {policy}, scenario {number}")
            tables[f"{policy}, {number}"] = formation_convergence(scenario, policy, guide)
    return condensed(tables)


def paper_figures(
    first: Scenario, second: Scenario, guide: Guide, seed: int = 0
) -> FigureCatalogue:
    """The paper's Figures 1 to 4, in its layout: maps of a run each, and the naive guides."""
    runs = {
        "figure-1": (first, "leader", "leader protection, scenario I"),
        "figure-2": (first, "constrained", "constrained trajectory, scenario I"),
        "figure-3": (second, "leader", "leader protection, scenario II"),
    }
    figures: FigureCatalogue = {}
    for name, (scenario, policy, words) in runs.items():
        number, trace = run_like_the_papers(scenario, policy, guide, seed)
        title, kept = f"{words}, run {number}", policy == "constrained"
        figures[name] = partial(swarm_map, scenario, trace, guide, title, corridors=kept)
    title = "naive, every member's own guide: its survival alone and arrival"
    guides = {f"member {k}": own for k, own in enumerate(member_guides(first, guide), start=1)}
    figures["figure-4"] = partial(comparison_map, first, guides, title)
    return figures


def run_like_the_papers(
    scenario: Scenario, policy: str, guide: Guide, seed: int = 0, runs: int = 200
) -> tuple[int, RunTrajectory]:
    """The first run that succeeds and loses two members, as the paper tells of its Figures 1 and 2.

    Where there is none among `runs`, the first that succeeds, or else the first. With its number.
    """
    study = simulate(scenario, [policy], runs, seed, guide=guide, save_trajectories=runs)
    success = study.runs["success"].to_numpy(bool)
    two_lost = study.runs["survivors"].to_numpy() == scenario.n - 2
    wanted = [*np.flatnonzero(success & two_lost), *np.flatnonzero(success), 0]
    return int(wanted[0]), study.trajectories[policy][int(wanted[0])]


def _charts(tables: Mapping[str, pd.DataFrame], guide: Guide, runs: int) -> FigureCatalogue:
    """The figures of the tables that there are."""
    charts: FigureCatalogue = {}
    if "table-2" in tables:
        charts["table-2"] = partial(table_2_chart, tables["table-2"], runs)
    if "sensitivity" in tables:
        intervals = {
            name: wilson(round(value * PAPER_RUNS), PAPER_RUNS)
            for name, value in PAPER_SUCCESS.items()
        }
        charts["sensitivity"] = partial(sensitivity_chart, tables["sensitivity"], intervals)
    if "guide-convergence" in tables and "formation-convergence" in tables:
        best = plan(load_scenario("paper-1"), search="global", certify=False)
        references = {
            "Ipopt, from the straight line": guide.survival,
            "global search": best.survival,
        }
        charts["convergence"] = partial(
            convergence_chart,
            tables["guide-convergence"],
            tables["formation-convergence"],
            references,
        )
    if "infeasible" in tables:
        charts["infeasible"] = partial(infeasible_chart, tables["infeasible"])
    if "beyond" in tables:
        charts["beyond"] = partial(
            success_chart, tables["beyond"], "success with other guides and in other scenarios"
        )
    return charts

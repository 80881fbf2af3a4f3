"""Which figures a command leaves, by the names of their files: made from results, drawn later."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from ..chain.distribution import OutcomeDistribution
from ..chain.trajectories import RunTrajectory
from ..figures import (
    arrival_chart,
    comparison_map,
    cost_to_go_map,
    difference_chart,
    formation_chart,
    guide_map,
    joint_map,
    population_chart,
    success_chart,
    survival_chart,
    swarm_map,
    sweep_heat_map,
    sweep_lines,
)
from ..figures.closeups import follows_guide
from ..planning.bounds import CostToGoMap
from ..planning.guide import Candidate, Guide
from ..scenario import Scenario
from ..typing import FloatArray

FigureCatalogue = dict[str, Callable[[], Figure]]
"""Functions that draw a figure in the look of their context, by the figure's name."""


def plan_figures(
    scenario: Scenario,
    guide: Guide,
    others: Sequence[Candidate | FloatArray] = (),
    rivals: Mapping[str, Guide] | None = None,
    outlook: CostToGoMap | None = None,
) -> FigureCatalogue:
    """Of a plan: the guide among the other ways, its rivals, and the way on from everywhere."""
    found: FigureCatalogue = {"guide": partial(guide_map, scenario, guide, others)}
    if rivals:
        found["comparison"] = partial(comparison_map, scenario, rivals)
    if outlook is not None:
        found["cost-to-go"] = partial(cost_to_go_map, scenario, outlook, guide)
    return found


def swarm_plan_figures(
    scenario: Scenario, positions: FloatArray, survival: FloatArray | None, success: str, bound: str
) -> FigureCatalogue:
    """Of a joint plan; `success` and `bound` are said in its title."""
    title = "; ".join(part for part in (f"joint plan, success {success}", bound) if part)
    return {"joint": partial(joint_map, scenario, positions, survival, title)}


def simulation_figures(
    scenario: Scenario,
    guide: Guide,
    summary: pd.DataFrame,
    paired: pd.DataFrame,
    traces: Mapping[str, Sequence[RunTrajectory]],
    run: int = 0,
) -> FigureCatalogue:
    """Of a simulation: success, differences, and of one run of every policy map and close-ups."""
    found: FigureCatalogue = {"success": partial(success_chart, summary, scenario.name)}
    if len(paired):
        found["differences"] = partial(difference_chart, paired, scenario.name)
    for policy, kept in traces.items():
        if run >= len(kept):
            continue
        title = f"{scenario.name}, {policy}, run {run}"
        near = guide if follows_guide(kept[run], guide, scenario.formation.rho) else None
        look: dict[str, Any] = {
            "title": title,
            "corridors": near is not None and "constrained" in policy,
        }
        found[f"run-{policy}"] = partial(swarm_map, scenario, kept[run], guide, **look)
        if scenario.n > 1:
            found[f"formation-{policy}"] = partial(
                formation_chart, scenario, kept[run], near, **look
            )
    return found


def evaluation_figures(
    scenario: Scenario, laws: Sequence[OutcomeDistribution], successes: pd.DataFrame
) -> FigureCatalogue:
    """Of exact laws; `successes` is the table of the laws, or of estimates where there are any."""
    name = scenario.name
    return {
        "success": partial(success_chart, successes, name),
        "arrival": partial(arrival_chart, laws, name),
        "population": partial(population_chart, laws, scenario.n, name),
        "survival": partial(survival_chart, laws, name),
    }


def sweep_figures(name: str, table: pd.DataFrame, keys: Sequence[str]) -> FigureCatalogue:
    """Of a sweep: lines over every parameter of several values, a heat map where there are two."""
    found: FigureCatalogue = {}
    varied = [key for key in keys if table[key].nunique() > 1]
    for key in varied:
        others = [other for other in varied if other != key]
        drawn: Any = partial(sweep_lines, table, key, name, others)
        found[f"over-{key.replace('.', '-')}"] = drawn
    if len(varied) == 2:
        found["heat-map"] = partial(sweep_heat_map, table, varied, name)
    return found

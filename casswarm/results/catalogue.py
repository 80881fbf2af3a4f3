"""Figures of every command by the names of their files, from results, drawn on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .. import figures
from ..chain.distribution import OutcomeDistribution
from ..chain.monte_carlo import RunTrajectory
from ..figures.formations import follows_guide, formation_title
from ..figures.maps import ending
from ..figures.success import EXACT, PAIRED, kind_of_success
from ..grid import CostToGoMap
from ..guide.guide import Candidate, Guide
from ..scenario import Scenario
from ..scenario.ambiguity import Mixture
from ..typing import FloatArray

FigureCatalogue = dict[str, Callable[[], Figure]]
"""Functions that draw a figure in the theme of their context, by the figure's name."""


def plan_figures(
    scenario: Scenario,
    guide: Guide,
    others: Sequence[Candidate | FloatArray] = (),
    baselines: Mapping[str, Guide] | None = None,
    costs: CostToGoMap | None = None,
) -> FigureCatalogue:
    """Figures of a plan: the guide, its comparison with baselines, and the cost-to-go map."""
    catalogue: FigureCatalogue = {"guide": partial(figures.guide_map, scenario, guide, others)}
    if baselines:
        catalogue["comparison"] = partial(figures.comparison_map, scenario, baselines)
    if costs is not None:
        catalogue["cost-to-go"] = partial(figures.cost_to_go_map, scenario, costs, guide)
    return catalogue


def mixture_figures(scenario: Scenario, mixed: Mixture) -> FigureCatalogue:
    """Figure of a mixture of guides or joint plans."""
    return {"mixture": partial(figures.mixture_map, scenario, mixed)}


def swarm_plan_figures(
    scenario: Scenario, positions: FloatArray, survival: FloatArray | None, success: str, bound: str
) -> FigureCatalogue:
    """Figure of a joint plan; texts of its success and its bound are part of the title."""
    title = "; ".join(part for part in (f"joint plan, success {success}", bound) if part)
    return {
        "joint": partial(
            figures.joint_map, scenario, positions, survival, f"{scenario.name}: {title}"
        )
    }


def simulation_figures(
    scenario: Scenario,
    guide: Guide,
    summary: pd.DataFrame,
    paired: pd.DataFrame,
    trajectories: Mapping[str, RunTrajectory],
    run: int,
    cases: pd.DataFrame | None = None,
) -> FigureCatalogue:
    """Figures of a simulation: success, differences, and run number `run` of every policy."""
    name = scenario.name
    heading = f"{name}: {kind_of_success(summary)}"
    catalogue: FigureCatalogue = {"success": partial(figures.success_chart, summary, heading)}
    catalogue |= _case_figures(name, cases)
    if len(paired):
        catalogue["differences"] = partial(figures.difference_chart, paired, f"{name}: {PAIRED}")
    for policy, trajectory in trajectories.items():
        follows = follows_guide(trajectory, guide, scenario.formation.rho)
        shown = f"{name}, {policy}, run {run}"
        options: dict[str, Any] = {"corridors": follows and "constrained" in policy}
        heading = f"{shown}: {ending(trajectory)}"
        catalogue[f"run-{policy}"] = partial(
            figures.swarm_map, scenario, trajectory, guide, heading, **options
        )
        if scenario.n > 1:
            center = guide if follows else None
            heading = f"{shown}: {formation_title(center)}"
            catalogue[f"formation-{policy}"] = partial(
                figures.formation_chart, scenario, trajectory, center, heading, **options
            )
    return catalogue


def evaluation_figures(
    scenario: Scenario,
    distributions: Sequence[OutcomeDistribution],
    successes: pd.DataFrame,
    cases: pd.DataFrame | None = None,
    information: pd.DataFrame | None = None,
) -> FigureCatalogue:
    """Figures of exact distributions, with the table of their success or of estimates."""
    name = scenario.name
    heading = f"{name}: {kind_of_success(successes)}"
    exact = f"{name}: {EXACT}"
    return {
        "success": partial(figures.success_chart, successes, heading),
        "arrival": partial(figures.arrival_chart, distributions, exact),
        "population": partial(figures.population_chart, distributions, scenario.n, exact),
        "survival": partial(figures.survival_chart, distributions, exact),
        **_case_figures(name, cases),
        **(
            {}
            if information is None
            else {"information": partial(figures.information_chart, information, name)}
        ),
    }


def _case_figures(name: str, cases: pd.DataFrame | None) -> FigureCatalogue:
    """Figure of success in every case of a hazard that is not known, and for the prior."""
    if cases is None:
        return {}
    names = map(_case_name, cases["case"], cases["weight"])
    panels = cases.assign(scenario=list(names))
    title = f"{name}: success by case of the hazard"
    return {"cases": partial(figures.success_chart, panels, title)}


def _case_name(case: object, weight: float) -> str:
    return "prior" if case == "prior" else f"case {case}, weight {weight:.3g}"


def sweep_figures(name: str, table: pd.DataFrame, keys: Sequence[str]) -> FigureCatalogue:
    """Figures of a sweep: lines over every varied parameter, and a heat map if there are two."""
    catalogue: FigureCatalogue = {}
    varied = [key for key in keys if table[key].nunique() > 1]
    for key in varied:
        others = [other for other in varied if other != key]
        over = f"over-{key.replace('.', '-')}"
        catalogue[over] = partial(figures.sweep_lines, table, key, name, others)
    if len(varied) == 2:
        catalogue["heat-map"] = partial(figures.sweep_heat_map, table, varied, name)
    return catalogue

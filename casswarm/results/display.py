"""Results as HTML for notebooks: a title, a table and a picture."""

from __future__ import annotations

from functools import singledispatch
from html import escape
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from .._util.documents import figure_uri, html_table
from ..chain.distribution import OutcomeDistribution
from ..comparison import Comparison
from ..figures import arrival_chart, success_chart, theme
from ..figures.base_map import add_start, base_map
from ..figures.style import add_legend, single_panel, themed
from ..planning.guide import Guide, rounded_up
from ..planning.joint import SwarmPlan
from ..scenario import Scenario
from ..studies.simulation import Study
from ..studies.tables import count_notes, summary_texts
from ..typing import FloatArray


@singledispatch
def html(result: object) -> str:
    """HTML of a result; without a table and a picture for objects of other types."""
    return f"<pre>{escape(repr(result))}</pre>"


@html.register
def _(result: Scenario) -> str:
    limits = f"{result.swarm.v_max:g}, {result.swarm.a_max:g}"
    values = {
        "members": result.n,
        "radars": len(result.hazard.radar_positions),
        "target radius": f"{result.target.radius:g}",
        "steps": f"{result.n_steps} of {result.time.dt:g}",
        "v_max, a_max": limits,
    }
    return _page(result.name, values, _scenario_map(result), result.description)


@html.register
def _(result: Guide) -> str:
    bound = result.survival_bound
    values = {
        "arrival step": result.arrival if result.arrives else "does not arrive",
        "survival": f"{result.survival:.4f}",
        "survival bound": "not certified" if bound is None else f"{rounded_up(bound):.4f}",
        "search": result.search,
        "solver": f"{result.solution.solver}: {result.solution.status}",
    }
    figure = _path_map(result.positions[:, None], [f"guide, {result.arrival} steps"])
    return _page("Guide", values, figure)


@html.register
def _(result: SwarmPlan) -> str:
    values = {
        "members": result.n,
        "steps": result.steps,
        result.objective: f"{result.value:.6f}",
        "bound of any policy": "not computed" if result.bound is None else str(result.bound),
        "solver": f"{result.solution.solver}: {result.solution.status}",
    }
    labels = [f"member {member + 1}" for member in range(result.n)]
    return _page(f"Joint plan of {result.scenario}", values, _path_map(result.positions, labels))


@html.register
def _(result: Study) -> str:
    name = result.scenario.name
    with theme("column"):
        figure = success_chart(result.summary, name)
    notes = "\n".join(count_notes(result.summary.to_dict("records")))
    return _page(f"Simulation of {name}", summary_texts(result.summary), figure, notes)


@html.register
def _(result: OutcomeDistribution) -> str:
    survivors = result.survivors_mean
    values = {
        "policy": result.policy,
        "success": f"{result.success.low:.6f} to {result.success.high:.6f}",
        "survivors, mean": f"{survivors.low:.3f} to {survivors.high:.3f}",
        "states": result.states,
        "residual mass": f"{result.residual_mass:.3g}",
    }
    with theme("column"):
        figure = arrival_chart([result], "")
    return _page("Outcome distribution", values, figure, result.advice)


@html.register
def _(result: Comparison) -> str:
    from ..comparison.report import figures

    with theme("column"):
        figure = next(iter(figures(result).values()))
    return _page("Comparison of solvers", result.summary.round(4), figure)


@themed
def _scenario_map(scenario: Scenario) -> Figure:
    figure, axes = base_map(scenario, [scenario.positions])
    add_start(axes, scenario.positions, "initial positions")
    add_legend(figure, axes)
    return figure


@themed
def _path_map(positions: FloatArray, labels: list[str]) -> Figure:
    """Paths (T+1, n, 2) without a scenario, which neither guides nor joint plans know."""
    figure, axes = single_panel()
    for path, label in zip(np.moveaxis(positions, 1, 0), labels, strict=True):
        axes.plot(*path.T, marker="o", markersize=2.5, label=label)
    axes.set(aspect="equal", xlabel="x", ylabel="y")
    add_legend(figure, axes)
    return figure


def _page(title: str, table: dict[str, Any] | pd.DataFrame, figure: Figure, note: str = "") -> str:
    """Title, lines of a note, table and picture; a dictionary is a table of one row."""
    frame = pd.DataFrame([table]) if isinstance(table, dict) else table
    lines = "".join(f"<br>{escape(line)}" for line in note.splitlines())
    return (
        f"<p><strong>{escape(title)}</strong>{lines}</p>"
        f'<div style="overflow-x: auto">{html_table(frame)}</div>'
        f'<img src="{figure_uri(figure, dpi=100)}" alt="{escape(title)}" style="max-width: 100%">'
    )

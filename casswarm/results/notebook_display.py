"""Results in notebooks: a title, a table and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from .._util.documents import figure_uri, html_table
from .._util.figure_style import add_legend, single_panel, themed
from .._util.numbers import rounded_up
from .._util.text import counted
from ..chain.distribution import OutcomeDistribution
from ..comparison import Comparison, Convergence
from ..figures import (
    arrival_chart,
    gap_chart,
    guide_map,
    joint_map,
    success_chart,
    sweep_lines,
    theme,
)
from ..figures.maps import add_start, base_map
from ..guide.guide import Guide
from ..joint import SwarmPlan
from ..scenario import Scenario
from ..studies.simulation import Study
from ..studies.sweep import Sweep
from ..studies.tables import count_notes, summary_texts
from ..typing import FloatArray, ThemeName


class View(NamedTuple):
    """Title, table and notes above a notebook's picture; a mapping is a table of one row."""

    title: str
    table: Mapping[str, Any] | pd.DataFrame
    notes: str = ""  # lines below the title


def html(result: object) -> str:
    """HTML of a result: title, table and picture."""
    title, table, notes = view(result)
    frame = table if isinstance(table, pd.DataFrame) else pd.DataFrame([table])
    picture = figure_uri(figure(result, None, "column"), dpi=100)
    lines = "".join(f"<br>{escape(line)}" for line in notes.splitlines())
    return (
        f"<p><strong>{escape(title)}</strong>{lines}</p>"
        f'<div style="overflow-x: auto">{html_table(frame)}</div>'
        f'<img src="{picture}" alt="{escape(title)}" style="max-width: 100%">'
    )


def figure(result: object, scenario: Scenario | None, size: ThemeName) -> Figure:
    """Picture of a result in a theme; a guide's or joint plan's with their scenario, if given."""
    with theme(size):
        return picture(result, scenario)


@singledispatch
def view(result: object) -> View:
    """Title and table of a result."""
    raise TypeError(f"{type(result).__name__} has no table")


@singledispatch
def picture(result: object, scenario: Scenario | None) -> Figure:
    """Picture of a result in the theme of the context."""
    raise TypeError(f"{type(result).__name__} has no picture (scenario: {scenario})")


@view.register
def _(result: Scenario) -> View:
    values = {
        "members": result.n,
        "radars": len(result.hazard.radar_positions),
        "target radius": f"{result.target.radius:g}",
        "steps": f"{result.n_steps} of {result.time.dt:g}",
        "v_max, a_max": f"{result.swarm.v_max:g}, {result.swarm.a_max:g}",
    }
    return View(result.name, values, result.description)


@picture.register
@themed
def _(result: Scenario, _: Scenario | None) -> Figure:
    fig, axes = base_map(result, [result.positions])
    add_start(axes, result.positions, "initial positions")
    add_legend(fig, axes)
    return fig


@view.register
def _(result: Guide) -> View:
    bound = result.survival_bound
    values = {
        "arrival step": result.arrival if result.arrives else "does not arrive",
        "survival": f"{result.survival:.4f}",
        "survival bound": "not certified" if bound is None else f"{rounded_up(bound):.4f}",
        "search": result.search,
        "solver": f"{result.solution.solver}: {result.solution.status}",
    }
    return View("Guide", values)


@picture.register
def _(result: Guide, scenario: Scenario | None) -> Figure:
    if scenario is not None:
        return guide_map(scenario, result)
    return _path_map(result.positions[:, None], [f"guide, {counted(result.arrival, 'step')}"])


@view.register
def _(result: SwarmPlan) -> View:
    values = {
        "members": result.n,
        "steps": result.steps,
        result.objective: f"{result.value:.6f}",
        "bound of any policy": "not computed" if result.bound is None else str(result.bound),
        "solver": f"{result.solution.solver}: {result.solution.status}",
    }
    return View(f"Joint plan of {result.scenario}", values)


@picture.register
def _(result: SwarmPlan, scenario: Scenario | None) -> Figure:
    if scenario is not None:
        law = result.distribution
        return joint_map(scenario, result.positions, None if law is None else law.survival)
    return _path_map(result.positions, [f"member {member}" for member in range(result.n)])


@view.register
def _(result: Study) -> View:
    notes = "\n".join(count_notes(result.summary.to_dict("records")))
    return View(f"Simulation of {result.scenario.name}", summary_texts(result.summary), notes)


@picture.register
def _(result: Study, _: Scenario | None) -> Figure:
    return success_chart(result.summary, result.scenario.name)


@view.register
def _(result: OutcomeDistribution) -> View:
    survivors = result.survivors_mean
    values = {
        "policy": result.policy,
        "success": f"{result.success.low:.6f} to {result.success.high:.6f}",
        "survivors, mean": f"{survivors.low:.3f} to {survivors.high:.3f}",
        "states": result.states,
        "residual mass": f"{result.residual_mass:.3g}",
    }
    return View("Outcome distribution", values, result.advice)


@picture.register
def _(result: OutcomeDistribution, _: Scenario | None) -> Figure:
    return arrival_chart([result], "")


@view.register
def _(result: Sweep) -> View:
    return View(f"Sweep of {result.scenario.name}", result.table.round(4))


@picture.register
def _(result: Sweep, _: Scenario | None) -> Figure:
    return sweep_lines(result.table, result.keys[0], result.scenario.name, result.keys[1:])


@view.register
def _(result: Comparison) -> View:
    return View("Comparison of solvers", result.summary.round(4))


@picture.register
def _(result: Comparison, _: Scenario | None) -> Figure:
    from ..comparison.report import overview

    return overview(result)()


@view.register
def _(result: Convergence) -> View:
    last = result.iterates.groupby("solver", sort=False).tail(1)
    table = last.drop(columns="feasible").map(lambda x: f"{x:.6g}" if isinstance(x, float) else x)
    notes = "\n".join(f"{solver}: {reason}" for solver, reason in result.missing.items())
    return View(f"Last iterates on {result.problem}, {result.start} start", table, notes)


@picture.register
def _(result: Convergence, _: Scenario | None) -> Figure:
    title = f"{result.problem}, {result.start} start"
    return gap_chart(result.iterates, title, result.solvers, tuple(result.missing))


@themed
def _path_map(positions: FloatArray, labels: list[str]) -> Figure:
    """Paths (T+1, n, 2) without a scenario, which neither guides nor joint plans know."""
    figure, axes = single_panel()
    for path, label in zip(np.moveaxis(positions, 1, 0), labels, strict=True):
        axes.plot(*path.T, marker="o", markersize=2.5, label=label)
    axes.set(aspect="equal", xlabel="x", ylabel="y")
    add_legend(figure, axes)
    return figure

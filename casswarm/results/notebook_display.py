"""Results in notebooks: a title, a table and a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
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
    """How a result is shown: a title, notes and a table above a picture."""

    title: str
    table: Mapping[str, Any] | pd.DataFrame  # a mapping is a table of one row
    picture: Callable[[Scenario | None], Figure]  # with the scenario of a guide or plan, if given
    notes: str = ""  # lines below the title


def html(result: object) -> str:
    """HTML of a result: title, table and picture."""
    title, table, picture, notes = view(result)
    frame = table if isinstance(table, pd.DataFrame) else pd.DataFrame([table])
    with theme("column"):
        address = figure_uri(picture(None), dpi=100)
    lines = "".join(f"<br>{escape(line)}" for line in notes.splitlines())
    return (
        f"<p><strong>{escape(title)}</strong>{lines}</p>"
        f'<div style="overflow-x: auto">{html_table(frame)}</div>'
        f'<img src="{address}" alt="{escape(title)}" style="max-width: 100%">'
    )


def figure(result: object, scenario: Scenario | None, size: ThemeName | None) -> Figure:
    """Picture of a result, by default in the theme of the context; a guide's with its scenario."""
    shown = view(result)
    with nullcontext() if size is None else theme(size):
        return shown.picture(scenario)


@singledispatch
def view(result: object) -> View:
    """Title, table and picture of a result."""
    raise TypeError(f"{type(result).__name__} has no table and picture")


@view.register
def _(result: Scenario) -> View:
    values = {
        "members": result.n,
        "radars": len(result.hazard.radar_positions),
        "target radius": f"{result.target.radius:g}",
        "steps": f"{result.n_steps} of {result.time.dt:g}",
        "v_max, a_max": f"{result.swarm.v_max:g}, {result.swarm.a_max:g}",
    }
    return View(result.name, values, lambda _: _start_map(result), result.description)


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

    def picture(scenario: Scenario | None) -> Figure:
        if scenario is not None:
            return guide_map(scenario, result)
        return _path_map(result.positions[:, None], [f"guide, {counted(result.arrival, 'step')}"])

    return View("Guide", values, picture)


@view.register
def _(result: SwarmPlan) -> View:
    values = {
        "members": result.n,
        "steps": result.steps,
        result.objective: f"{result.value:.6f}",
        "bound of any policy": "not computed" if result.bound is None else str(result.bound),
        "solver": f"{result.solution.solver}: {result.solution.status}",
    }

    def picture(scenario: Scenario | None) -> Figure:
        if scenario is not None:
            law = result.distribution
            return joint_map(scenario, result.positions, None if law is None else law.survival)
        return _path_map(result.positions, [f"member {member}" for member in range(result.n)])

    return View(f"Joint plan of {result.scenario}", values, picture)


@view.register
def _(result: Study) -> View:
    name, summary = result.scenario.name, result.summary
    notes = "\n".join(count_notes(summary.to_dict("records")))
    table = summary_texts(summary)
    return View(f"Simulation of {name}", table, lambda _: success_chart(summary, name), notes)


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
    return View("Outcome distribution", values, lambda _: arrival_chart([result]), result.advice)


@view.register
def _(result: Sweep) -> View:
    table, keys, name = result.table, result.keys, result.scenario.name
    lines = table, keys[0], name, keys[1:]
    return View(f"Sweep of {name}", table.round(4), lambda _: sweep_lines(*lines))


@view.register
def _(result: Comparison) -> View:
    from ..comparison.report import overview

    return View("Comparison of solvers", result.summary.round(4), lambda _: overview(result)())


@view.register
def _(result: Convergence) -> View:
    last = result.iterates.groupby("solver", sort=False).tail(1)
    table = last.drop(columns="feasible").map(lambda x: f"{x:.6g}" if isinstance(x, float) else x)
    notes = "\n".join(f"{solver}: {reason}" for solver, reason in result.missing.items())
    title = f"{result.problem}, {result.start} start"
    gaps = result.iterates, title, result.solvers, tuple(result.missing)
    return View(f"Last iterates on {title}", table, lambda _: gap_chart(*gaps), notes)


@themed
def _start_map(scenario: Scenario) -> Figure:
    """Map with the initial positions."""
    fig, axes = base_map(scenario, [scenario.positions])
    add_start(axes, scenario.positions, "initial positions")
    add_legend(fig, axes)
    return fig


@themed
def _path_map(positions: FloatArray, labels: list[str]) -> Figure:
    """Paths (T+1, n, 2) without a scenario, which neither guides nor joint plans know."""
    figure, axes = single_panel()
    for path, label in zip(np.moveaxis(positions, 1, 0), labels, strict=True):
        axes.plot(*path.T, marker="o", markersize=2.5, label=label)
    axes.set(aspect="equal", xlabel="x", ylabel="y")
    add_legend(figure, axes)
    return figure

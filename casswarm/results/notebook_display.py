"""Results in notebooks: a title, a table and a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial, singledispatch
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from .._util.documents import figure_uri, html_table
from .._util.figure_style import AxesLike, add_legend, add_title, literal, single_panel, themed
from .._util.numbers import rounded_up
from .._util.text import counted
from ..chain.distribution import OutcomeDistribution
from ..comparison import Comparison, Convergence
from ..comparison.verification import start_text
from ..figures import (
    arrival_chart,
    gap_chart,
    guide_map,
    joint_map,
    mixture_map,
    success_chart,
    sweep_lines,
    theme,
)
from ..figures.maps import add_start, base_map
from ..figures.success import kind_of_success
from ..guide.guide import Guide
from ..guide.mixture import MixedGuide
from ..joint import MixedPlan, SwarmPlan
from ..scenario import Scenario
from ..scenario.ambiguity import Mixture
from ..scenario.cases import radars_text
from ..studies.simulation import Study
from ..studies.sweep import Sweep
from ..studies.tables import count_notes, summary_texts
from ..typing import FloatArray, ThemeName


class View(NamedTuple):
    """How a result is shown: a title, notes and a table above a picture."""

    title: str
    table: Mapping[str, Any] | pd.DataFrame  # a mapping is a table of one row
    picture: Callable[..., Figure]  # of the scenario, if given, with options `title` and `ax`
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


def figure(
    result: object, scenario: Scenario | None, size: ThemeName | None, **options: Any
) -> Figure:
    """Picture of a result, by default in the theme of the context; a guide's with its scenario."""
    shown = view(result)
    with nullcontext() if size is None else theme(size):
        return shown.picture(scenario, **options)


@singledispatch
def view(result: object) -> View:
    """Title, table and picture of a result."""
    raise TypeError(f"{type(result).__name__} has no table and picture")


@view.register
def _(result: Scenario) -> View:
    table = result.hazard_table
    values = {
        "members": result.n,
        "radars": radars_text(table) if table.case else len(table.starts),
        "target radius": f"{result.target.radius:g}",
        "steps": f"{result.n_steps} of {result.time.dt:g}",
        "v_max, a_max": f"{result.swarm.v_max:g}, {result.swarm.a_max:g}",
    }
    return View(
        result.name, values, lambda _, **options: _start_map(result, **options), result.description
    )


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

    def picture(scenario: Scenario | None, **options: Any) -> Figure:
        if scenario is not None:
            return guide_map(scenario, result, **options)
        label = f"guide, {counted(result.arrival, 'step')}"
        return _path_map(result.positions[:, None], [label], **options)

    return View("Guide", values, picture)


@view.register
def _(result: MixedGuide) -> View:
    return _mixture_view(result, "guide")


@view.register
def _(result: MixedPlan) -> View:
    return _mixture_view(result, "joint plan")


def _mixture_view(result: Mixture, what: str) -> View:
    measure, (low, high) = result.measure, result.value
    if measure == "risk":
        low, high = high, low
    values = {
        "ambiguity": str(result.ambiguity),
        measure: f"{low:.4f}",
        f"{measure} bound": "not certified" if high in (0.0, 1.0) else f"{rounded_up(high):.4f}",
        f"best single {what}": f"{result.pure_value:.4f}",
        "with the case known": f"{result.known_value:.4f}",
    }

    def picture(scenario: Scenario | None, **options: Any) -> Figure:
        if scenario is not None:
            return mixture_map(scenario, result, **options)
        last = max(map(len, result.routes))
        padded = [np.concatenate([p, np.repeat(p[-1:], last - len(p), 0)]) for p in result.routes]
        labels = [
            f"{what} with probability {weight:.3f}"
            + (f", member {member}" if route.shape[1] > 1 else "")
            for route, weight in zip(result.routes, result.weights, strict=True)
            for member in range(route.shape[1])
        ]
        return _path_map(np.concatenate(padded, axis=1), labels, **options)

    return View(f"Mixture of {counted(len(result.weights), what)}", values, picture, result.note)


@view.register
def _(result: SwarmPlan) -> View:
    values = {
        "members": result.n,
        "steps": result.steps,
        result.objective: f"{result.value:.6f}",
        "bound of any policy": "not computed" if result.bound is None else str(result.bound),
        "solver": f"{result.solution.solver}: {result.solution.status}",
    }

    def picture(scenario: Scenario | None, **options: Any) -> Figure:
        if scenario is not None:
            law = result.distribution
            survival = None if law is None else law.survival
            return joint_map(scenario, result.positions, survival, **options)
        labels = [f"member {member}" for member in range(result.n)]
        return _path_map(result.positions, labels, **options)

    return View(f"Joint plan of {result.scenario}", values, picture)


@view.register
def _(result: Study) -> View:
    name, summary = result.scenario.name, result.summary
    notes = "\n".join(count_notes(summary.to_dict("records")))
    table = summary_texts(summary)
    heading = f"{name}: {kind_of_success(summary)}"
    picture = partial(success_chart, summary)
    return View(
        f"Simulation of {name}",
        table,
        lambda _, **options: picture(**{"title": heading} | options),
        notes,
    )


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
    return View(
        "Outcome distribution",
        values,
        lambda _, **options: arrival_chart([result], **options),
        result.advice,
    )


@view.register
def _(result: Sweep) -> View:
    table, keys, name = result.table, result.keys, result.scenario.name
    lines = partial(sweep_lines, table, keys[0], title=name, others=keys[1:])
    return View(f"Sweep of {name}", table.round(4), lambda _, **options: lines(**options))


@view.register
def _(result: Comparison) -> View:
    from ..comparison.report import overview

    return View(
        "Comparison of solvers",
        result.summary.round(4),
        lambda _, **options: overview(result)(**options),
    )


@view.register
def _(result: Convergence) -> View:
    last = result.iterates.groupby("solver", sort=False).tail(1)
    table = last.drop(columns="feasible").map(lambda x: f"{x:.6g}" if isinstance(x, float) else x)
    notes = "\n".join(f"{solver}: {reason}" for solver, reason in result.missing.items())
    title = f"{result.problem}, {start_text(result.start)}"
    more: dict[str, Any] = {
        "title": literal(title),
        "order": result.solvers,
        "missing": tuple(result.missing),
    }
    gaps = partial(gap_chart, result.iterates, **more)
    return View(f"Last iterates on {title}", table, lambda _, **options: gaps(**options), notes)


@themed
def _start_map(scenario: Scenario, title: str | None = "", *, ax: AxesLike | None = None) -> Figure:
    """Map with the initial positions."""
    fig, axes = base_map(scenario, [scenario.positions], ax=ax)
    add_start(axes, scenario.positions, "initial positions")
    add_legend(axes)
    add_title(axes, title or "")
    return fig


@themed
def _path_map(
    positions: FloatArray,
    labels: list[str],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Paths (T+1, n, 2) without a scenario, which neither guides nor joint plans know."""
    figure, axes = single_panel(None, title or "", ax)
    for path, label in zip(np.moveaxis(positions, 1, 0), labels, strict=True):
        axes.plot(*path.T, marker="o", markersize=2.5, label=label)
    axes.set(aspect="equal", xlabel="x", ylabel="y")
    add_legend(axes)
    return figure

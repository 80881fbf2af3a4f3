"""Figures of the paper's reproduction: Table II, sensitivity, empty sets, convergence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .._util.figure_style import (
    GREY,
    GRID,
    INK,
    AxesLike,
    add_legend,
    current_theme,
    despine,
    heading,
    label_outer,
    marker,
    panels,
    scaled,
    single_panel,
    themed,
    wrap,
)
from .maps import add_label
from .success import policy_styles

_HOLLOW = "s^"  # markers of few runs, whose values have two digits
_DASHES = ("-", "--", "-.", ":")
_ALPHAS = {"displacement": 1.0, "velocity": 0.35}  # of the variable in which steps are taken


@themed
def table_2_chart(
    table: pd.DataFrame,
    paper_runs: int = 50,
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Table II: the paper's probabilities, those by its method, and exact ones, with intervals.

    Parameters
    ----------
    table : DataFrame
        With the columns policy; paper and ``runs_K`` (the paper's method, K runs), each with the
        ends ``_low`` and ``_high`` of its interval; and the bounds method_low, method_high,
        exact_low and exact_high.
    paper_runs : int
        Number of runs K.
    title, ax
        As in all `casswarm.figures`.
    """
    kinds = {
        "paper": (f"the paper, {paper_runs} runs", "s"),
        f"runs_{paper_runs}": (f"the paper's method, {paper_runs} runs", "^"),
        "method": ("the paper's method", "D"),
        "exact": ("with Ipopt, exact", "|"),
    }
    aspect = current_theme().aspect_of(1.45 * len(kinds) * len(table) + 7)
    fig, axes = single_panel(aspect, heading(title, "paper-1", "Table II, with 95 % intervals"), ax)
    styles = policy_styles(table["policy"])
    for row, values in enumerate(table.to_dict("records")):
        color = styles[str(values["policy"])].color
        for number, (column, (_, shape)) in enumerate(kinds.items()):
            low, high = values[f"{column}_low"], values[f"{column}_high"]
            estimate = values.get(column, (low + high) / 2)
            y = row + 0.2 * (number - (len(kinds) - 1) / 2)
            axes.plot([low, high], [y] * 2, color=color, linewidth=scaled(1.6), zorder=2)
            axes.plot(estimate, y, zorder=3, **_marker(shape, color))
            text = f"{estimate:.{2 if shape in _HOLLOW else 3}f}"
            add_label(axes, text, (max(high, estimate), y), (6, 0), va="center")
    axes.set_yticks(range(len(table)), list(table["policy"]), fontsize="medium")
    axes.set(xlim=(0.15, 0.87), ylim=(len(table) - 0.5, -0.5), xlabel="success probability")
    despine(axes, grid="x")
    for row in range(1, len(table)):
        axes.axhline(row - 0.5, color=GRID, linewidth=scaled(0.6))
    handles = [Line2D([], [], label=label, **_marker(kind, GREY)) for label, kind in kinds.values()]
    add_legend(axes, handles, 2)
    return fig


def _marker(shape: str, color: str) -> dict[str, Any]:
    """Arguments of ``Axes.plot`` for a marker."""
    size, edge_width = (10, 2.0) if shape == "|" else (5, 1.2)
    face = {"markerfacecolor": "white"} if shape in _HOLLOW else {}
    return marker(shape, size, color, color, edge_width) | face


@themed
def sensitivity_chart(
    table: pd.DataFrame,
    intervals: Mapping[str, tuple[float, float]],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Success under small changes of the geometry, by two solvers, with the paper's intervals.

    Parameters
    ----------
    table : DataFrame
        With the columns solver, change, and for every policy of `intervals` its success and the
        ends ``_low`` and ``_high`` of its interval. The first solver has filled markers.
    intervals : mapping
        Policy to (low, high), drawn as a band.
    title, ax
        As in all `casswarm.figures`.
    """
    changes = list(dict.fromkeys(table["change"]))
    aspect, number = current_theme().aspect_of(2.4 * len(changes) + 9), len(intervals)
    text = heading(title, "paper-1", "small changes of the geometry")
    fig, axes = panels(number, number, aspect, text, ax, sharex=True, sharey=True)
    styles, kinds = policy_styles(intervals), list(dict.fromkeys(table["solver"]))
    for panel, (policy, (low, high)) in zip(axes, intervals.items(), strict=True):
        style = styles[policy]
        panel.axvspan(low, high, color=style.color, alpha=0.15, linewidth=0)
        for number, solver in enumerate(kinds):
            rows = table[(table["solver"] == solver) & table[policy].notna()]
            y = np.array([changes.index(change) for change in rows["change"]])
            y = y + 0.3 * (number - (len(kinds) - 1) / 2)
            ends = rows[f"{policy}_low"], rows[f"{policy}_high"]
            panel.hlines(y, *ends, color=style.color, linewidth=scaled(1.2))
            face = "white" if number else style.color
            panel.plot(rows[policy], y, **marker(style.marker, 4, face, style.color))
        panel.set_title(policy)
        despine(panel, grid="x")
    axes[0].set_yticks(range(len(changes)), [wrap(change, 0.375) for change in changes])
    axes[0].set(ylim=(len(changes) - 0.5, -0.5), xlim=(-0.05, 1.0), xticks=[0.2, 0.4, 0.6, 0.8])
    handles = [
        Line2D([], [], label=solver, **marker("o", 4, "white" if number else GREY, GREY))
        for number, solver in enumerate(kinds)
    ]
    bands = wrap("success; shaded: Wilson's 95 % interval of the paper's 50 runs")
    add_legend(axes[-1], handles, 2, title=bands)
    return fig


@themed
def infeasible_chart(
    table: pd.DataFrame, title: str | None = "", *, ax: AxesLike | None = None
) -> Figure:
    """Mean number of members alive, and of those with an empty constraint set, at every step.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, step, alive and infeasible.
    title, ax
        As in all `casswarm.figures`.
    """
    policies = list(dict.fromkeys(table["policy"]))
    text = heading(title, "members with an empty constraint set")
    narrow = current_theme().narrow
    aspect = 0.5 * len(policies) + 0.15 if narrow else None
    across = 1 if narrow else len(policies)
    fig, axes = panels(len(policies), across, aspect, text, ax, sharex=True, sharey=True)
    styles = policy_styles(policies)
    for panel, policy in zip(axes, policies, strict=True):
        rows = table[table["policy"] == policy]
        panel.bar(rows["step"], rows["infeasible"], color=styles[str(policy)].color, width=0.8)
        panel.step(rows["step"], rows["alive"], where="mid", color=INK)
        panel.set(title=str(policy), xlabel="step", ylabel="mean number of members")
        panel.set_ylim(0, 1.1 * float(table["alive"].max()))
        label_outer(panel)
        despine(panel)
    handles = [
        Line2D([], [], color=INK, label="alive"),
        Line2D([], [], color=GREY, linewidth=scaled(5), label="with an empty constraint set"),
    ]
    add_legend(axes[-1], handles, 2)
    return fig


@themed
def convergence_chart(
    guide: pd.DataFrame,
    formations: pd.DataFrame,
    references: Mapping[str, float],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Gaps and stationarity residuals of the projected gradient, for the guide and formations.

    Parameters
    ----------
    guide : DataFrame
        With the columns steps (displacement or velocity), iteration, survival and residual.
    formations : DataFrame
        With the columns problems (a policy, a comma and a scenario), steps, iteration, gap_median
        and residual_median.
    references : mapping
        Name to the survival of other guides.
    title, ax
        As in all `casswarm.figures`.
    """
    narrow = current_theme().narrow
    across = 1 if narrow else 2
    shown = "steps in displacement (dark) or velocity (light); formations: medians over time steps"
    text = heading(title, "the paper's projected gradient", shown)
    fig, axes = panels(4, across, 2.3 if narrow else 0.75, text, ax, sharex=True)
    survival, residual, gap, formation_residual = axes
    for variable, rows in guide.groupby("steps"):
        path: dict[str, Any] = {"color": INK, "marker": "o", "alpha": _ALPHAS[str(variable)]}
        survival.plot(rows["iteration"], rows["survival"], **path)
        residual.plot(rows["iteration"], rows["residual"], **path)
    for number, (name, value) in enumerate(references.items()):
        survival.axhline(value, color=GREY, linewidth=scaled(), linestyle=_DASHES[1 + number % 3])
        add_label(survival, f"{name}: {value:.2g}", (1, value), (0, 3))
    survival.set(title="guide: single-agent survival", yscale="log", ylim=(5e-5, 5))
    residual.set(title="guide: stationarity residual", yscale="log")
    styles = policy_styles(str(kind).split(",")[0] for kind in formations["problems"])
    kinds = list(dict.fromkeys(formations["problems"]))
    for (kind, steps), rows in formations.groupby(["problems", "steps"], sort=False):
        style: dict[str, Any] = {
            "color": styles[str(kind).split(",")[0]].color,
            "linestyle": _DASHES[kinds.index(kind) % len(_DASHES)],
            "label": str(kind) if steps == "displacement" else None,
            "alpha": _ALPHAS[str(steps)],
        }
        for panel, column in ((gap, "gap_median"), (formation_residual, "residual_median")):
            panel.plot(rows["iteration"], rows[column].clip(lower=1e-9), **style)
    gap.set(title="formation: gap to the best known objective", yscale="log")
    formation_residual.set(title="formation: stationarity residual", yscale="log")
    for panel in axes:
        panel.set_xscale("symlog", linthresh=1)
        panel.set(xlim=(0, 1e4), xticks=[0, 1, 10, 100, 1000, 10000])
        despine(panel)
    for panel in axes[-across:]:
        panel.set_xlabel("iteration")
    handles, columns = gap.get_legend_handles_labels()[0], 2 if narrow else 4
    add_legend(axes[-1], handles, columns, title="formation of")
    return fig

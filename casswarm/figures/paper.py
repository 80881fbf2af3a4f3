"""Figures of the paper's reproduction: Table II, sensitivity, and empty constraint sets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .policy_styles import policy_styles
from .style import (
    GREY,
    GRID,
    INK,
    add_title,
    current_theme,
    despine,
    panels,
    scaled,
    single_panel,
    themed,
    wrap,
)


@themed
def table_2_chart(table: pd.DataFrame, runs: int, paper_runs: int = 50) -> Figure:
    """Table II: the paper's, the exact and the simulated probabilities, with their intervals.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, paper, paper_low, paper_high, exact_low, exact_high, and for both
        numbers of runs ``runs_K``, ``runs_K_low`` and ``runs_K_high``.
    runs, paper_runs : int
        Numbers of runs.
    """
    kinds = {
        "paper": (f"the paper, {paper_runs} runs", _marker("s", filled=False)),
        f"runs_{paper_runs}": (f"casswarm, {paper_runs} runs", _marker("^", filled=False)),
        f"runs_{runs}": (f"casswarm, {runs:,} runs", _marker("D")),
        "exact": ("casswarm, exact", _marker("|")),
    }
    fig, axes = single_panel(current_theme().aspect_of(1.45 * len(kinds) * len(table) + 7))
    styles = policy_styles(table["policy"])
    for row, values in enumerate(table.to_dict("records")):
        color = styles[str(values["policy"])].color
        for number, (column, (_, marker)) in enumerate(kinds.items()):
            low, high = values[f"{column}_low"], values[f"{column}_high"]
            estimate = (low + high) / 2 if column == "exact" else values[column]
            y = row + 0.2 * (number - (len(kinds) - 1) / 2)
            axes.plot([low, high], [y] * 2, color=color, linewidth=scaled(1.6), zorder=2)
            axes.plot(estimate, y, color=color, zorder=3, **marker)
            axes.annotate(
                f"{estimate:.2f}"
                if column in ("paper", f"runs_{paper_runs}")
                else f"{estimate:.3f}",
                (max(high, estimate), y),
                (scaled(6), 0),
                textcoords="offset points",
                va="center",
                fontsize="small",
            )
    axes.set_yticks(range(len(table)), list(table["policy"]), fontsize="medium")
    axes.set(xlim=(0.15, 0.87), ylim=(len(table) - 0.5, -0.5), xlabel="success probability")
    despine(axes, grid="x")
    for row in range(1, len(table)):
        axes.axhline(row - 0.5, color=GRID, linewidth=scaled(0.6))
    handles = [
        Line2D([], [], color=GREY, label=label, **marker) for label, marker in kinds.values()
    ]
    columns = 4 if current_theme().characters > 90 else 2
    fig.legend(handles=handles, loc="outside lower center", ncols=columns)
    add_title(fig, "paper-1", "Table II, with Wilson's 95 % intervals")
    return fig


def _marker(marker: str, filled: bool = True) -> dict[str, Any]:
    """Arguments of ``Axes.plot`` for a marker."""
    bar = marker == "|"
    return {
        "linestyle": "",
        "marker": marker,
        "markersize": scaled(10 if bar else 5),
        "markeredgewidth": scaled(2 if bar else 1.2),
    } | ({} if filled else {"markerfacecolor": "white"})


@themed
def sensitivity_chart(table: pd.DataFrame, intervals: Mapping[str, tuple[float, float]]) -> Figure:
    """Exact success under small changes of the geometry, with the paper's intervals.

    Parameters
    ----------
    table : DataFrame
        With the columns change and every policy of `intervals`.
    intervals : mapping
        Policy to (low, high), drawn as a band.
    """
    theme, styles, y = current_theme(), policy_styles(intervals), np.arange(len(table))
    aspect = theme.aspect_of(2.0 * len(table) + 7)
    fig, axes = panels(len(intervals), len(intervals), aspect, sharex=True, sharey=True)
    for panel, (policy, (low, high)) in zip(axes, intervals.items(), strict=True):
        style = styles[policy]
        panel.axvspan(low, high, color=style.color, alpha=0.15, linewidth=0)
        panel.axvline(float(table[policy].iloc[0]), color=INK, linewidth=scaled(0.8), linestyle=":")
        panel.plot(table[policy], y, color=style.color, marker=style.marker, linestyle="")
        panel.set_title(policy)
        despine(panel, grid="x")
    axes[0].set_yticks(y, [wrap(change, 0.375) for change in table["change"]])
    axes[0].set(xlim=(0.15, 0.85), ylim=(len(table) - 0.5, -0.5), xticks=[0.2, 0.4, 0.6, 0.8])
    label = "exact success; shaded: Wilson's 95 % interval of the paper's 50 runs"
    fig.supxlabel(wrap(label), fontsize="medium")
    add_title(fig, "paper-1", "small changes of the geometry")
    return fig


@themed
def infeasible_chart(table: pd.DataFrame) -> Figure:
    """Mean number of members alive, and of those with an empty constraint set, at every step.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, step, alive and infeasible.
    """
    policies = list(dict.fromkeys(table["policy"]))
    narrow = current_theme().narrow
    aspect = 0.5 * len(policies) + 0.15 if narrow else None
    across = 1 if narrow else len(policies)
    fig, axes = panels(len(policies), across, aspect, sharex=True, sharey=True)
    styles = policy_styles(policies)
    for panel, policy in zip(axes, policies, strict=True):
        rows = table[table["policy"] == policy]
        panel.bar(rows["step"], rows["infeasible"], color=styles[str(policy)].color, width=0.8)
        panel.step(rows["step"], rows["alive"], where="mid", color=INK)
        panel.set(title=str(policy), xlabel="step", ylabel="mean number of members")
        panel.set_ylim(0, 1.1 * float(table["alive"].max()))
        panel.label_outer()
        despine(panel)
    handles = [
        Line2D([], [], color=INK, label="alive"),
        Line2D([], [], color=GREY, linewidth=scaled(5), label="with an empty constraint set"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=2)
    add_title(fig, "members with an empty constraint set")
    return fig

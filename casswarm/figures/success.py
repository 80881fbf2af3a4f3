"""Success probabilities of policies, and differences between policies."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..typing import FloatArray
from .policy_styles import policy_styles
from .style import (
    GREY,
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
def success_chart(table: pd.DataFrame, title: str = "") -> Figure:
    """Success probability of every policy with its interval, a panel per scenario.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, success_low and success_high, and optionally

        - success and runs of a simulation; bars without a success (of exact distributions, or of
          estimates) end at the lower bound;
        - scenario, of which every one gets a panel;
        - bound, the success that no policy exceeds in a scenario: a dashed line.
    title : str
    """
    several = "scenario" in table
    scenarios = (table if several else table.assign(scenario="")).groupby("scenario", sort=False)
    policies = list(dict.fromkeys(map(str, table["policy"])))
    columns = min(len(scenarios), 2 if current_theme().narrow else 3)
    lines = len(policies) * (1.5 if several else 2.4) + 4
    aspect = current_theme().aspect_of(lines * -(-len(scenarios) // columns) + 3)
    fig, axes = panels(len(scenarios), columns, max(0.28, aspect), sharex=True, sharey=True)
    for panel, (scenario, rows) in zip(axes, scenarios, strict=True):
        _bars(panel, rows, policies, values=not several)
        heading = wrap(scenario, 0.85 / columns)
        if "bound" in rows:
            bound = float(rows["bound"].iloc[0])
            panel.axvline(bound, color=GREY, linestyle="--", linewidth=scaled(1.0), zorder=3)
            heading += f"\nno policy exceeds {math.ceil(1000 * bound) / 1000:.3f}"
        panel.set_title(heading, fontsize="small")
        panel.set(xlim=(0, 1.03), ylim=(len(policies) - 0.4, -0.6))
        panel.set_xticks([0, 0.5, 1] if several else np.arange(6) / 5)
        panel.set_yticks(range(len(policies)), policies)
        despine(panel, grid="x")
    for panel in axes[-columns:]:
        panel.set_xlabel("success probability")
        panel.tick_params(labelbottom=True)
    add_title(fig, title, "" if several else _kind(table))
    return fig


def _bars(axes: Axes, rows: pd.DataFrame, policies: list[str], values: bool) -> None:
    """Draw a bar and an interval per policy, with their values on the right if asked for."""
    styles, names = policy_styles(policies), list(map(str, rows["policy"]))
    simulated = "success" in rows
    rows = rows if simulated else rows.assign(success=rows["success_low"])
    success, error = with_errors(rows, "success")
    y, size = [policies.index(name) for name in names], 1.0 if values else 0.6
    axes.barh(y, success, height=0.6, color=[styles[name].color for name in names], alpha=0.85)
    width, cap = scaled(1.3 * size), scaled(5 * size)
    axes.errorbar(
        success, y, xerr=error, fmt="none", ecolor=INK, linewidth=width, capsize=cap, zorder=4
    )
    if not values:
        return
    intervals = map(_interval, rows["success_low"], rows["success_high"])
    texts = [f"{value:.3f}" for value in success] if simulated else intervals
    place = axes.get_yaxis_transform()
    for text, row in zip(texts, y, strict=True):
        axes.annotate(text, (1.01, row), xycoords=place, va="center", fontsize="small")


def with_errors(rows: pd.DataFrame, name: str) -> tuple[FloatArray, FloatArray]:
    """Values of a column, and the lengths (2, ...) of error bars to NAME_low and to NAME_high."""
    values, low, high = (rows[name + end].to_numpy(float) for end in ("", "_low", "_high"))
    return values, np.maximum(0.0, [values - low, high - values])


def _kind(table: pd.DataFrame) -> str:
    """What the numbers of a single scenario are."""
    if "runs" not in table:
        return "exact distribution, lower and upper bounds"
    runs = f"{int(table['runs'].min()):,} runs per policy, 95 % intervals"
    return runs if "success" in table else f"exact enumeration and {runs}"


def _interval(low: float, high: float) -> str:
    """Text of an interval: one number where its ends agree to four digits."""
    return f"{low:.4f}" if f"{low:.4f}" == f"{high:.4f}" else f"{low:.4f}\nto {high:.4f}"


@themed
def difference_chart(paired: pd.DataFrame, title: str = "") -> Figure:
    """Paired differences in success between policies, with their 95 % intervals.

    Parameters
    ----------
    paired : DataFrame
        As of `casswarm.studies.tables.paired_table`.
    title : str
    """
    fig, axes = single_panel(min(1.2, (0.9 + 0.32 * len(paired)) / 4))
    rows = np.arange(len(paired))[::-1]
    difference, error = with_errors(paired, "difference")
    axes.axvline(0.0, color=INK, linewidth=scaled(0.8), zorder=1)
    axes.errorbar(difference, rows, xerr=error, fmt="o", color=INK, capsize=scaled(4), zorder=3)
    names = [f"{a} − {b}" for a, b in zip(paired["first"], paired["second"], strict=True)]
    axes.set_yticks(rows, names, fontsize="medium")
    lowest, highest = paired["difference_low"].min(), paired["difference_high"].max()
    ends = np.array([min(-0.02, lowest), max(0.02, highest)])
    axes.set(xlim=ends + 0.08 * np.ptp(ends) * np.array([-1, 1]), ylim=(-0.7, len(paired) - 0.3))
    axes.set_xlabel("difference in success probability,\n95 % interval")
    add_title(fig, title, "paired by common random numbers")
    despine(axes, grid="x")
    return fig

"""Sweeps: success over one parameter as lines, over two as heat maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .style import MEMBERS, POLICIES, figure, tidy


def sweep_lines(
    table: pd.DataFrame, key: str, title: str = "", others: Sequence[str] = ()
) -> Figure:
    """Success of every policy over a parameter, with its bracket or interval.

    Parameters
    ----------
    table : DataFrame
        With a column `key`, policy, success, success_low, success_high, status. Cells that failed
        are left out.
    key : str
    title : str
    others : sequence of str
        Columns of parameters that vary too: a line for every combination of their values.
    """
    fig, axes = figure(6.4, 4.2)
    good = table[table["status"] == "ok"]
    number = pd.api.types.is_numeric_dtype(table[key])
    order = list(dict.fromkeys(table[key]))
    lines = good.groupby(["policy", *others], sort=False)
    policies = list(dict.fromkeys(good["policy"]))
    labelled = set()
    for names, cells in lines:
        policy = str(names[0])
        place = policies.index(policy)
        rows = cells.sort_values(key) if number else cells
        x = rows[key].to_numpy(float) if number else np.array([order.index(v) for v in rows[key]])
        y = rows["success"].to_numpy(float)
        low, high = rows["success_low"].to_numpy(float), rows["success_high"].to_numpy(float)
        axes.errorbar(
            x,
            y,
            [np.maximum(0.0, y - low), np.maximum(0.0, high - y)],
            color=POLICIES.get(policy, MEMBERS[place % len(MEMBERS)]),
            marker="osD^v"[place % 5],
            markersize=4 if others else 5,
            linewidth=1.0 if others else 1.5,
            linestyle=("-", "--", "-.", ":")[place % 4] if number else "none",
            capsize=3,
            label="_" if policy in labelled else policy,
        )
        labelled.add(policy)
        if others and place == 0:
            values = ", ".join(_shown(value) for value in names[1:])
            axes.annotate(values, (x[-1], y[-1]), (6, 0), textcoords="offset points", fontsize=8)
    if not number:
        axes.set_xticks(range(len(order)), [str(value) for value in order])
    elif len(order) <= 8:
        axes.set_xticks(order, [_shown(value) for value in order])
    axes.set(xlabel=key, ylabel="success probability", ylim=(0, 1.02))
    note = f"a line for every {', '.join(others)}" if others else ""
    axes.set_title("\n".join(filter(None, (title, note))), fontsize=11)
    if len(good):
        axes.legend(frameon=False)
    tidy(axes)
    return fig


def sweep_heat_map(table: pd.DataFrame, keys: Sequence[str], title: str = "") -> Figure:
    """Success over two parameters, a panel a policy; cells that failed are crossed out.

    Parameters
    ----------
    table : DataFrame
        As in `sweep_lines`.
    keys : two of its columns
        Across, and up.
    title : str
    """
    across, up = keys
    policies = list(dict.fromkeys(table["policy"]))
    columns, rows = (list(dict.fromkeys(table[key])) for key in keys)
    width = min(16.0, 1.2 + len(policies) * max(2.6, 0.62 * len(columns) + 1))
    fig = Figure(figsize=(width, max(3.0, 0.5 * len(rows) + 1.6)), layout="compressed")
    FigureCanvasAgg(fig)
    panels = fig.subplots(1, len(policies), squeeze=False, sharey=True)[0]
    for axes, policy in zip(panels, policies, strict=True):
        values = np.full((len(rows), len(columns)), np.nan)
        for row in table[table["policy"] == policy].to_dict("records"):
            values[rows.index(row[up]), columns.index(row[across])] = row["success"]
        image = axes.imshow(values, origin="lower", vmin=0, vmax=1, cmap="cividis", aspect="auto")
        for (i, j), value in np.ndenumerate(values):
            text = "×" if np.isnan(value) else f"{value:.2f}"
            color = "black" if np.isnan(value) or value > 0.55 else "white"
            axes.text(j, i, text, ha="center", va="center", fontsize=8, color=color)
        axes.set_xticks(range(len(columns)), [_shown(value) for value in columns])
        axes.set_yticks(range(len(rows)), [_shown(value) for value in rows])
        axes.set(xlabel=across)
        axes.set_title(policy, fontsize=10)
    panels[0].set_ylabel(up)
    fig.colorbar(image, ax=list(panels), label="success probability")
    fig.suptitle(title, fontsize=11)
    return fig


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)

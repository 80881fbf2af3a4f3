"""Sweeps: success over one parameter as lines, over two as heat maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .policy_styles import policy_styles
from .style import (
    add_title,
    current_theme,
    despine,
    format_value,
    panels,
    scaled,
    single_panel,
    themed,
)

_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)))


@themed
def sweep_lines(
    table: pd.DataFrame, key: str, title: str = "", others: Sequence[str] = ()
) -> Figure:
    """Success of every policy over a parameter, with its interval.

    Parameters
    ----------
    table : DataFrame
        With the columns `key`, policy, success, success_low, success_high and status. Sweep points
        that failed are left out.
    key : str
    title : str
    others : sequence of str
        Columns of parameters that vary as well: there is a panel per policy, with a line for every
        combination of their values.
    """
    valid = table[table["status"] == "ok"]
    order = list(dict.fromkeys(table[key]))
    if others:
        return _panel_per_policy(valid, key, order, title, list(others))
    fig, axes = single_panel()
    styles = policy_styles(table["policy"])
    for policy, rows in valid.groupby("policy", sort=False):
        success_line(axes, rows, key, order, styles[str(policy)].line | {"label": str(policy)})
    _finish(axes, key, order)
    axes.set_ylabel("success probability")
    if len(valid):
        axes.legend(loc="best")
    add_title(fig, title)
    return fig


def _panel_per_policy(
    valid: pd.DataFrame, key: str, order: list[Any], title: str, others: list[str]
) -> Figure:
    policies, narrow = list(dict.fromkeys(valid["policy"])), current_theme().narrow
    number = max(1, len(policies))
    columns = 1 if narrow else min(3, number)
    aspect = (0.52 if narrow else 0.4) * -(-number // columns) + 0.12
    fig, axes = panels(number, columns, aspect, sharex=True, sharey=True)
    combinations = valid.groupby(others, sort=False).ngroup()
    colors = colormaps["viridis"](np.linspace(0.0, 0.82, max(2, combinations.nunique())))
    for panel, policy in zip(axes, policies, strict=False):
        for index, rows in valid[valid["policy"] == policy].groupby(combinations):
            style = {
                "color": colors[index],
                "marker": "osD^vP"[index % 6],
                "linestyle": _DASHES[index % len(_DASHES)],
                "label": ", ".join(map(format_value, rows[others].iloc[0])),
            }
            success_line(panel, rows, key, order, style)
        _finish(panel, key, order)
        panel.set_title(str(policy))
        panel.label_outer()
    fig.supylabel("success probability", fontsize="medium")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(
        handles,
        labels,
        loc="outside lower center" if narrow else "outside right upper",
        title=", ".join(others),
        title_fontsize="small",
        ncols=3 if narrow else 1,
    )
    add_title(fig, title)
    return fig


def success_line(
    axes: Axes, rows: pd.DataFrame, key: str, order: list[Any], style: dict[str, Any]
) -> None:
    """Draw success over a parameter's values, with its interval as error bars."""
    numeric = _numeric(order)
    rows = rows.sort_values(key) if numeric else rows
    x = rows[key].to_numpy(float) if numeric else np.array([order.index(v) for v in rows[key]])
    y = rows["success"].to_numpy(float)
    low, high = rows["success_low"].to_numpy(float), rows["success_high"].to_numpy(float)
    error = [np.maximum(0.0, y - low), np.maximum(0.0, high - y)]
    axes.errorbar(x, y, error, **style | ({} if numeric else {"linestyle": "none"}))


def _finish(axes: Axes, key: str, order: list[Any]) -> None:
    if not _numeric(order):
        axes.set_xticks(range(len(order)), [str(value) for value in order])
    else:
        if min(order) > 0 and max(order) >= 30 * min(order):
            axes.set_xscale("log")
            axes.minorticks_off()
        if len(order) <= 8:
            axes.set_xticks(order, [format_value(value) for value in order])
    axes.set(xlabel=key, ylim=(0, 1.02))
    despine(axes)


def _numeric(values: Sequence[Any]) -> bool:
    return bool(pd.api.types.is_numeric_dtype(pd.Series(list(values))))


@themed
def sweep_heat_map(table: pd.DataFrame, keys: Sequence[str], title: str = "") -> Figure:
    """Success over two parameters, a panel per policy; sweep points that failed are crossed out.

    Parameters
    ----------
    table : DataFrame
        As in `sweep_lines`.
    keys : two of its columns
        Along x, and along y.
    title : str
    """
    x, y = keys
    theme, policies = current_theme(), list(dict.fromkeys(table["policy"]))
    columns, rows = (list(dict.fromkeys(table[key])) for key in keys)
    across = min(len(policies), 1 if theme.narrow else 3)
    aspect = 0.16 + min(0.9, 0.66 * scaled() * len(rows) / theme.width)
    aspect = aspect * -(-len(policies) // across) + 0.12
    fig, axes = panels(len(policies), across, aspect, sharex=True, sharey=True)
    for panel, policy in zip(axes, policies, strict=True):
        values = np.full((len(rows), len(columns)), np.nan)
        for row in table[table["policy"] == policy].to_dict("records"):
            values[rows.index(row[y]), columns.index(row[x])] = row["success"]
        image = panel.imshow(values, origin="lower", vmin=0, vmax=1, cmap="cividis", aspect="auto")
        size = 0.8 * theme.font_size * min(1.0, 9.0 / (across * len(columns)))
        for (i, j), value in np.ndenumerate(values):
            text = "×" if np.isnan(value) else f"{value:.2f}"
            color = "black" if np.isnan(value) or value > 0.55 else "white"
            panel.text(j, i, text, ha="center", va="center", fontsize=max(4.0, size), color=color)
        panel.set_xticks(range(len(columns)), [format_value(value) for value in columns])
        panel.set_yticks(range(len(rows)), [format_value(value) for value in rows])
        panel.set_title(str(policy))
        panel.set(xlabel=x, ylabel=y)
        panel.label_outer()
    fig.colorbar(image, ax=axes, label="success probability")
    add_title(fig, title)
    return fig

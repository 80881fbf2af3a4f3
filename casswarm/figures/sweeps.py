"""Sweeps: success over one parameter as lines, over two as heat maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import (
    add_title,
    current_theme,
    despine,
    figure,
    format_value,
    panels,
    policy_styles,
    scaled,
    themed,
)

_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)))


@themed
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
        Columns of parameters that vary too: a panel for every policy, and in it a line for every
        combination of their values.
    """
    good = table[table["status"] == "ok"]
    order = list(dict.fromkeys(table[key]))
    if others:
        return _by_policy(good, key, order, title, list(others))
    fig, axes = figure()
    looks = policy_styles(table["policy"])
    for policy, rows in good.groupby("policy", sort=False):
        mark = looks[str(policy)]
        look = {"color": mark.color, "marker": mark.marker, "linestyle": mark.dashes}
        success_line(axes, rows, key, order, look, str(policy))
    _finish(axes, key, order)
    axes.set_ylabel("success probability")
    if len(good):
        axes.legend(loc="best")
    add_title(fig, title)
    return fig


def _by_policy(
    good: pd.DataFrame, key: str, order: list[Any], title: str, others: list[str]
) -> Figure:
    policies = list(dict.fromkeys(good["policy"]))
    narrow = current_theme().width < 5
    columns = 1 if narrow else min(3, max(1, len(policies)))
    rows = -(-max(1, len(policies)) // columns)
    shape = (0.52 if narrow else 0.4) * rows + 0.12
    fig, places = panels(columns, rows, shape, sharex=True, sharey=True)
    combinations = [tuple(c) for c in good[others].drop_duplicates().itertuples(index=False)]
    colors = colormaps["viridis"](np.linspace(0.0, 0.82, max(2, len(combinations))))
    for axes, policy in zip(places, policies, strict=False):
        own = good[good["policy"] == policy]
        for number, values in enumerate(combinations):
            part = own[(own[others] == list(values)).all(axis=1)]
            look = {
                "color": colors[number],
                "marker": "osD^vP"[number % 6],
                "linestyle": _DASHES[number % len(_DASHES)],
            }
            success_line(axes, part, key, order, look, ", ".join(map(format_value, values)))
        _finish(axes, key, order)
        axes.set_title(str(policy))
        axes.label_outer()
    for axes in places[len(policies) :]:
        axes.set_visible(False)
    fig.supylabel("success probability", fontsize="medium")
    handles, labels = places[0].get_legend_handles_labels()
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
    axes: Axes, rows: pd.DataFrame, key: str, order: list[Any], look: dict[str, Any], label: str
) -> None:
    """Success over a parameter's values, with what is known of it as error bars."""
    number = _numbers(order)
    rows = rows.sort_values(key) if number else rows
    x = rows[key].to_numpy(float) if number else np.array([order.index(v) for v in rows[key]])
    y = rows["success"].to_numpy(float)
    low, high = rows["success_low"].to_numpy(float), rows["success_high"].to_numpy(float)
    error = [np.maximum(0.0, y - low), np.maximum(0.0, high - y)]
    axes.errorbar(x, y, error, label=label, **look | ({} if number else {"linestyle": "none"}))


def _finish(axes: Axes, key: str, order: list[Any]) -> None:
    if not _numbers(order):
        axes.set_xticks(range(len(order)), [str(value) for value in order])
    else:
        if min(order) > 0 and max(order) >= 30 * min(order):
            axes.set_xscale("log")
            axes.minorticks_off()
        if len(order) <= 8:
            axes.set_xticks(order, [format_value(value) for value in order])
    axes.set(xlabel=key, ylim=(0, 1.02))
    despine(axes)


def _numbers(values: Sequence[Any]) -> bool:
    return bool(pd.api.types.is_numeric_dtype(pd.Series(list(values))))


@themed
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
    narrow = current_theme().width < 5
    wide = min(len(policies), 1 if narrow else 3)
    high = -(-len(policies) // wide)
    shape = (
        high * (0.16 + min(0.9, 0.3 * scaled() * len(rows) / current_theme().width * 2.2)) + 0.12
    )
    fig, places = panels(wide, high, shape, sharex=True, sharey=True)
    for axes, policy in zip(places, policies, strict=False):
        values = np.full((len(rows), len(columns)), np.nan)
        for row in table[table["policy"] == policy].to_dict("records"):
            values[rows.index(row[up]), columns.index(row[across])] = row["success"]
        image = axes.imshow(values, origin="lower", vmin=0, vmax=1, cmap="cividis", aspect="auto")
        size = 0.8 * current_theme().letters * min(1.0, 9.0 / (wide * len(columns)))
        for (i, j), value in np.ndenumerate(values):
            text = "×" if np.isnan(value) else f"{value:.2f}"
            color = "black" if np.isnan(value) or value > 0.55 else "white"
            axes.text(j, i, text, ha="center", va="center", fontsize=max(4.0, size), color=color)
        axes.set_xticks(range(len(columns)), [format_value(value) for value in columns])
        axes.set_yticks(range(len(rows)), [format_value(value) for value in rows])
        axes.set_title(str(policy))
        axes.set(xlabel=across, ylabel=up)
        axes.label_outer()
    for axes in places[len(policies) :]:
        axes.set_visible(False)
    fig.colorbar(image, ax=places, label="success probability")
    add_title(fig, title)
    return fig

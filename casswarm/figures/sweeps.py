"""Success over parameters: over one or MPC horizons as lines, over two as heat maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .policy_styles import policy_styles
from .style import add_title, current_theme, despine, panels, scaled, single_panel, themed
from .success import with_errors

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
        _success_line(axes, rows, key, order, styles[str(policy)].line | {"label": str(policy)})
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
                "label": ", ".join(map(_text, rows[others].iloc[0])),
            }
            _success_line(panel, rows, key, order, style)
        _finish(panel, key, order)
        panel.set_title(str(policy))
        panel.label_outer()
    fig.supylabel("success probability", fontsize="medium")
    fig.legend(
        handles=axes[0].get_legend_handles_labels()[0],
        loc="outside lower center" if narrow else "outside right upper",
        title=", ".join(others),
        title_fontsize="small",
        ncols=3 if narrow else 1,
    )
    add_title(fig, title)
    return fig


def _success_line(
    axes: Axes, rows: pd.DataFrame, key: str, order: list[Any], style: dict[str, Any]
) -> None:
    """Draw success over a parameter's values, with its interval as error bars."""
    numeric = _numeric(order)
    rows = rows.sort_values(key) if numeric else rows
    x = rows[key].to_numpy(float) if numeric else np.array([order.index(v) for v in rows[key]])
    y, error = with_errors(rows, "success")
    axes.errorbar(x, y, error, **style | ({} if numeric else {"linestyle": "none"}))


def _finish(axes: Axes, key: str, order: list[Any]) -> None:
    if not _numeric(order):
        axes.set_xticks(range(len(order)), [str(value) for value in order])
    else:
        if min(order) > 0 and max(order) >= 30 * min(order):
            axes.set_xscale("log")
            axes.minorticks_off()
        if len(order) <= 8:
            axes.set_xticks(order, [_text(value) for value in order])
    axes.set(xlabel=key, ylim=(0, 1.02))
    despine(axes)


def _text(value: object) -> str:
    """Text of a parameter's value along an axis."""
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return f"{value:g}" if number else str(value)


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
        panel.set_xticks(range(len(columns)), [_text(value) for value in columns])
        panel.set_yticks(range(len(rows)), [_text(value) for value in rows])
        panel.set_title(str(policy))
        panel.set(xlabel=x, ylabel=y)
        panel.label_outer()
    fig.colorbar(image, ax=axes, label="success probability")
    add_title(fig, title)
    return fig


@themed
def mpc_chart(table: pd.DataFrame, title: str = "") -> Figure:
    """Success (above) and infeasible member-steps (below) over the horizon, a column per scenario.

    Parameters
    ----------
    table : DataFrame
        With the columns scenario, policy, horizon, success, success_low, success_high and
        infeasible (member-steps per run).
    title : str
    """
    scenarios = list(dict.fromkeys(table["scenario"]))
    horizons = sorted(set(table["horizon"]))
    across = min(len(scenarios), 2 if current_theme().narrow else 3)
    bands = -(-len(scenarios) // across)  # of two rows of panels each
    aspect = 1.25 * bands / max(2, across) + 0.12
    fig, axes = panels(2 * bands * across, across, aspect, sharex=True)
    grid: Any = np.array(axes).reshape(bands, 2, across)
    pairs = grid.swapaxes(1, 2).reshape(-1, 2)  # the panels of every scenario
    for unused in pairs[len(scenarios) :].flat:
        unused.set_visible(False)
    styles = policy_styles(table["policy"])
    for number, (scenario, (upper, lower)) in enumerate(zip(scenarios, pairs, strict=False)):
        rows_here = table[table["scenario"] == scenario].sort_values("horizon")
        for policy, rows in rows_here.groupby("policy", sort=False):
            style = styles[str(policy)].line
            _success_line(upper, rows, "horizon", horizons, style | {"label": str(policy)})
            lower.plot(rows["horizon"].to_numpy(float), rows["infeasible"], **style)
        upper.set(title=str(scenario), ylim=(-0.03, 1.03))
        lower.set_ylim(bottom=0.0)
        if number % across == 0:
            upper.set_ylabel("success")
            lower.set_ylabel("infeasible\nmember-steps")
        if number + across >= len(scenarios):  # the lowest of its column
            lower.tick_params(labelbottom=True)
            lower.set_xlabel("MPC horizon")
        for panel in (upper, lower):
            panel.set_xticks(horizons, [_text(horizon) for horizon in horizons])
            despine(panel)
    handles = axes[0].get_legend_handles_labels()[0]
    fig.legend(handles=handles, loc="outside lower center", ncols=min(3, len(handles)))
    add_title(fig, title)
    return fig

"""Success over policies, time and parameters: bars, lines and heat maps."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._util.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    AxesLike,
    add_legend,
    current_theme,
    despine,
    heading,
    label_outer,
    label_panels,
    panels,
    scaled,
    single_panel,
    themed,
    wrap,
)
from ..chain.distribution import OutcomeDistribution
from ..typing import FloatArray


@dataclass(frozen=True)
class PolicyStyle:
    """Colour, dashes and marker of a policy, which also differ in print without colours."""

    color: str
    dashes: Any
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """Arguments of ``Axes.plot``."""
        return {"color": self.color, "linestyle": self.dashes, "marker": self.marker}


POLICIES = {
    "naive": PolicyStyle(VERMILION, "-", "o"),
    "constrained": PolicyStyle(GREEN, (0, (5, 1.5)), "s"),
    "leader": PolicyStyle(BLUE, (0, (6, 1.5, 1, 1.5)), "D"),
    "constrained-feedback": PolicyStyle(ORANGE, (0, (3, 1)), "^"),
    "leader-feedback": PolicyStyle(SKY, (0, (2, 1, 1, 1)), "v"),
    "joint": PolicyStyle(PURPLE, (0, (1, 1)), "P"),
    "joint-replanning": PolicyStyle("#882255", (0, (4, 1, 1, 1)), "p"),  # darker shade
    "optimal": PolicyStyle("#555555", (0, (10, 2)), "X"),
    "constrained-mpc": PolicyStyle("#00573F", (0, (8, 1.5, 1, 1.5)), "d"),  # darker shade
    "leader-mpc": PolicyStyle("#003B6F", (0, (3, 1, 1, 1, 1, 1)), "*"),  # darker shade
}
"""Styles of the built-in policies in every figure; MPC policies of all horizons share one."""

_OTHERS = (
    PolicyStyle(INK, (0, (8, 2)), "X"),
    PolicyStyle(GREY, (0, (4, 1, 1, 1, 1, 1)), "h"),
    PolicyStyle("#7A5195", (0, (1, 2)), "<"),
    PolicyStyle("#8B5A2B", (0, (10, 2, 2, 2)), ">"),
)


def policy_styles(names: Iterable[str]) -> dict[str, PolicyStyle]:
    """Style of every policy, distinct as long as there are enough; users' own by their names."""
    styles: dict[str, PolicyStyle] = {}
    for name in dict.fromkeys(map(str, names)):
        first = crc32(name.encode()) % len(_OTHERS)
        builtin = POLICIES.get(re.sub(r"-mpc-\d+$", "-mpc", name))
        choices = [builtin] if builtin else []
        choices += [*_OTHERS[first:], *_OTHERS[:first]]
        unused = [style for style in choices if style not in styles.values()]
        styles[name] = (unused or choices)[0]
    return styles


EXACT = "exact distribution"
"""Default title of figures of exact distributions."""


@themed
def arrival_chart(
    distributions: Sequence[OutcomeDistribution],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Probability of arrival up to every step, a band per policy from lower to upper bound."""
    low = [np.cumsum(each.arrival) for each in distributions]
    high = [
        np.minimum(1.0, bound + each.residual_mass_before)
        for bound, each in zip(low, distributions, strict=True)
    ]
    bounds = list(zip(low, high, strict=True))
    fig, axes = _bands(distributions, bounds, title, "probability of arrival", ax=ax)
    labels = [f"{d.policy}: {d.success[0]:.4f} to {d.success[1]:.4f}" for d in distributions]
    axes.legend(axes.get_lines(), labels, loc="upper left")
    return fig


@themed
def population_chart(
    distributions: Sequence[OutcomeDistribution],
    members: int,
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Mean number of members alive at every step, a band per policy from lower to upper bound."""
    means = [each.population_mean for each in distributions]
    bounds = [(mean.low, np.minimum(float(members), mean.high)) for mean in means]
    fig, axes = _bands(distributions, bounds, title, "mean number of members alive", members, ax)
    axes.legend(loc="lower left")
    return fig


@themed
def survival_chart(
    distributions: Sequence[OutcomeDistribution],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Probability that any member is alive at every step, from lower to upper bound.

    After arrival a run keeps the number of members that arrived.
    """
    bounds = [each.any_alive for each in distributions]
    fig, axes = _bands(distributions, bounds, title, "probability that any member is alive", ax=ax)
    axes.legend(loc="lower left")
    return fig


def _bands(
    distributions: Sequence[OutcomeDistribution],
    bounds: Sequence[tuple[FloatArray, FloatArray]],
    title: str | None,
    ylabel: str,
    top: float = 1.0,
    ax: AxesLike | None = None,
) -> tuple[Figure, Axes]:
    """Step curves of the lower bounds (N+1,), with bands up to the upper bounds, up to `top`."""
    fig, axes = single_panel(None, heading(title, EXACT), ax)
    styles = policy_styles(each.policy for each in distributions)
    for (low, high), (policy, style) in zip(bounds, styles.items(), strict=True):
        steps = np.arange(len(low))
        axes.fill_between(steps, low, high, step="post", color=style.color, alpha=0.3, linewidth=0)
        (line,) = axes.step(steps, low, where="post", color=style.color, linestyle=style.dashes)
        line.set(linewidth=scaled(1.8), label=policy)
    axes.set(xlabel="step", xlim=(0, 1.01 * (max(len(low) for low, _ in bounds) - 1)))
    axes.set(ylabel=ylabel, ylim=(0, 1.02 * top))
    despine(axes)
    return fig, axes


@themed
def success_chart(
    table: pd.DataFrame, title: str | None = "", *, ax: AxesLike | None = None
) -> Figure:
    """Success probability of every policy with its interval, a panel per scenario.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, success_low and success_high, and optionally

        - success and runs of a simulation; bars without a success (of exact distributions, or of
          estimates) end at the lower bound;
        - scenario, of which every one gets a panel;
        - bound, the success that no policy exceeds in a scenario: a dashed line.
    title, ax
        As in all `casswarm.figures`.
    """
    several = "scenario" in table
    scenarios = (table if several else table.assign(scenario="")).groupby("scenario", sort=False)
    policies = list(dict.fromkeys(map(str, table["policy"])))
    columns = min(len(scenarios), 2 if current_theme().narrow else 3)
    lines = len(policies) * (1.5 if several else 2.4) + 4
    aspect = current_theme().aspect_of(lines * -(-len(scenarios) // columns) + 3)
    text = heading(title, "" if several else kind_of_success(table))
    options: dict[str, Any] = {"ax": ax, "sharex": True, "sharey": True}
    fig, axes = panels(len(scenarios), columns, max(0.28, aspect), text, **options)
    for panel, (scenario, rows) in zip(axes, scenarios, strict=True):
        _bars(panel, rows, policies, values=not several)
        name = wrap(scenario, 0.85 / columns)
        if "bound" in rows:
            bound = float(rows["bound"].iloc[0])
            panel.axvline(bound, color=GREY, linestyle="--", linewidth=scaled(1.0), zorder=3)
            name += f"\nno policy exceeds {math.ceil(1000 * bound) / 1000:.3f}"
        if name:
            panel.set_title(name, fontsize="small")
        panel.set(xlim=(0, 1.03), ylim=(len(policies) - 0.4, -0.6))
        panel.set_xticks([0, 0.5, 1] if several else np.arange(6) / 5)
        panel.set_yticks(range(len(policies)), policies)
        despine(panel, grid="x")
    for panel in axes[-columns:]:
        panel.set_xlabel("success probability")
        panel.tick_params(labelbottom=True)
    return fig


@themed
def information_chart(
    table: pd.DataFrame, title: str | None = "", *, ax: AxesLike | None = None
) -> Figure:
    """Success by what members know of the hazard, a panel each.

    Parameters
    ----------
    table : DataFrame
        Of `casswarm.value_of_information`.
    title, ax
        As in all `casswarm.figures`.
    """
    panels = table.rename(columns={"information": "scenario"})
    panels["scenario"] = "members know the " + panels["scenario"]
    return success_chart(panels, heading(title, "success by what members know"), ax=ax)


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


def kind_of_success(table: pd.DataFrame) -> str:
    """Describe the numbers of a single scenario: exact, sampled, or both."""
    if "runs" not in table:
        return "exact distribution, lower and upper bounds"
    runs = f"{int(table['runs'].min()):,} runs per policy, 95 % intervals"
    return runs if "success" in table else f"exact enumeration and {runs}"


def _interval(low: float, high: float) -> str:
    """Text of an interval: one number where its ends agree to four digits."""
    return f"{low:.4f}" if f"{low:.4f}" == f"{high:.4f}" else f"{low:.4f}\nto {high:.4f}"


PAIRED = "paired by common random numbers"
"""Default title of figures of differences."""


@themed
def difference_chart(
    paired: pd.DataFrame, title: str | None = "", *, ax: AxesLike | None = None
) -> Figure:
    """Paired differences in success between policies, with their 95 % intervals.

    Parameters
    ----------
    paired : DataFrame
        As of `casswarm.studies.tables.paired_table`.
    title, ax
        As in all `casswarm.figures`.
    """
    aspect = min(1.2, (0.9 + 0.32 * len(paired)) / 4)
    fig, axes = single_panel(aspect, heading(title, PAIRED), ax)
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
    despine(axes, grid="x")
    return fig


_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)))


@themed
def sweep_lines(
    table: pd.DataFrame,
    key: str,
    title: str | None = "",
    others: Sequence[str] = (),
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Success of every policy over a parameter, with its interval.

    Parameters
    ----------
    table : DataFrame
        With the columns `key`, policy, success, success_low, success_high and status. Sweep points
        that failed are left out.
    key : str
    title, ax
        As in all `casswarm.figures`.
    others : sequence of str
        Columns of parameters that vary as well: there is a panel per policy, with a line for every
        combination of their values.
    """
    valid = table[table["status"] == "ok"]
    order = list(dict.fromkeys(table[key]))
    if others:
        return _panel_per_policy(valid, key, order, title or "", list(others), ax)
    fig, axes = single_panel(None, title or "", ax)
    styles = policy_styles(table["policy"])
    for policy, rows in valid.groupby("policy", sort=False):
        _success_line(axes, rows, key, order, styles[str(policy)].line | {"label": str(policy)})
    _finish(axes, key, order)
    axes.set_ylabel("success probability")
    if len(valid):
        axes.legend(loc="best")
    return fig


def _panel_per_policy(
    valid: pd.DataFrame,
    key: str,
    order: list[Any],
    title: str,
    others: list[str],
    ax: AxesLike | None,
) -> Figure:
    policies, narrow = list(dict.fromkeys(valid["policy"])), current_theme().narrow
    number = max(1, len(policies))
    columns = 1 if narrow else min(3, number)
    aspect = (0.52 if narrow else 0.4) * -(-number // columns) + 0.12
    fig, axes = panels(number, columns, aspect, title, ax, sharex=True, sharey=True)
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
        label_outer(panel)
    label_panels(axes, ylabel="success probability")
    options = {"title": ", ".join(others), "title_fontsize": "small"}
    options |= {} if narrow else {"loc": "outside right upper"}
    add_legend(axes[-1], axes[0].get_legend_handles_labels()[0], 3 if narrow else 1, **options)
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
def sweep_heat_map(
    table: pd.DataFrame,
    keys: Sequence[str],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Success over two parameters, a panel per policy; sweep points that failed are crossed out.

    Parameters
    ----------
    table : DataFrame
        As in `sweep_lines`.
    keys : two of its columns
        Along x, and along y.
    title, ax
        As in all `casswarm.figures`.
    """
    x, y = keys
    theme, policies = current_theme(), list(dict.fromkeys(table["policy"]))
    columns, rows = (list(dict.fromkeys(table[key])) for key in keys)
    across = min(len(policies), 1 if theme.narrow else 3)
    aspect = 0.16 + min(0.9, 0.66 * scaled() * len(rows) / theme.width)
    aspect = aspect * -(-len(policies) // across) + 0.12
    fig, axes = panels(len(policies), across, aspect, title or "", ax, sharex=True, sharey=True)
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
        label_outer(panel)
    fig.colorbar(image, ax=axes, label="success probability")
    return fig


@themed
def mpc_chart(table: pd.DataFrame, title: str | None = "", *, ax: AxesLike | None = None) -> Figure:
    """Success (above) and infeasible member-steps (below) over the horizon, a column per scenario.

    Parameters
    ----------
    table : DataFrame
        With the columns scenario, policy, horizon, success, success_low, success_high and
        infeasible (member-steps per run).
    title, ax
        As in all `casswarm.figures`.
    """
    scenarios = list(dict.fromkeys(table["scenario"]))
    horizons = sorted(set(table["horizon"]))
    across = min(len(scenarios), 2 if current_theme().narrow else 3)
    bands = -(-len(scenarios) // across)  # of two rows of panels each
    aspect = 1.25 * bands / max(2, across) + 0.12
    fig, axes = panels(2 * bands * across, across, aspect, title or "", ax, sharex=True)
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
    add_legend(axes[-1], handles, min(3, len(handles)))
    return fig

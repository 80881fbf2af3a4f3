"""Figures of the paper reproduced: its naive guides, its tables as pictures, empty sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..planning.guide import Guide
from ..scenario import Scenario
from .base_map import single_agent_map
from .style import (
    GREY,
    INK,
    MEMBERS,
    add_legend,
    add_title,
    current_theme,
    despine,
    figure,
    panels,
    policy_styles,
    scaled,
    themed,
)


@themed
def member_guides_map(scenario: Scenario, guides: Sequence[Guide], title: str = "") -> Figure:
    """Every member's own guide over the map of a lone member's rates.

    Members often share a path: the first is drawn widest and lowest, so that all stay visible.
    """
    fig, axes, _ = single_agent_map(scenario, [guide.positions for guide in guides])
    for place, guide in enumerate(guides):
        width = 1.0 + 1.3 * (len(guides) - 1 - place)
        axes.plot(
            *guide.positions.T,
            color=MEMBERS[place % len(MEMBERS)],
            marker="o",
            markersize=scaled(width + 1.0),
            linewidth=scaled(width),
            solid_capstyle="round",
            zorder=4,
            label=f"member {place + 1}: {guide.survival:.3f},\nstep {guide.arrival}",
        )
    starts = np.array([guide.positions[0] for guide in guides])
    axes.plot(
        *starts.T,
        linestyle="",
        marker="o",
        markersize=scaled(4.5),
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=5,
        label="start",
    )
    add_legend(fig, axes)
    add_title(fig, scenario.name, title or "every member's own guide, its survival and arrival")
    return fig


@themed
def table_2_chart(table: pd.DataFrame, runs: int, few: int = 50) -> Figure:
    """Table II: the paper's numbers, the exact ones, and sampled ones, with their intervals.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, paper, paper_low, paper_high, exact_low, exact_high, and for both
        numbers of runs ``runs_K``, ``runs_K_low`` and ``runs_K_high``.
    runs, few : int
        The numbers of runs.
    """
    kinds = {
        "paper": (f"the paper, {few} runs", "s", "white"),
        f"runs_{few}": (f"casswarm, {few} runs", "^", "white"),
        f"runs_{runs}": (f"casswarm, {runs:,} runs", "D", None),
        "exact": ("casswarm, exact", "|", None),
    }
    fig, axes = figure(_shape(1.45 * len(kinds) * len(table) + 7))
    looks = policy_styles(table["policy"])
    for row, values in enumerate(table.to_dict("records")):
        color = looks[str(values["policy"])].color
        for place, (column, (_, marker, face)) in enumerate(kinds.items()):
            low, high = values[f"{column}_low"], values[f"{column}_high"]
            middle = (low + high) / 2 if column == "exact" else values[column]
            height = row + 0.2 * (place - (len(kinds) - 1) / 2)
            axes.plot([low, high], [height] * 2, color=color, linewidth=scaled(1.6), zorder=2)
            axes.plot(middle, height, color=color, zorder=3, **_sign(marker, face))
            axes.annotate(
                f"{middle:.2f}" if column in ("paper", f"runs_{few}") else f"{middle:.3f}",
                (max(high, middle), height),
                (scaled(6), 0),
                textcoords="offset points",
                va="center",
                fontsize="small",
            )
    axes.set_yticks(range(len(table)), list(table["policy"]), fontsize="medium")
    axes.set(xlim=(0.15, 0.87), ylim=(len(table) - 0.5, -0.5), xlabel="success probability")
    _rows(axes, len(table))
    handles = [
        Line2D([], [], color=GREY, label=label, **_sign(marker, face))
        for label, marker, face in kinds.values()
    ]
    columns = 4 if _letters() > 90 else 2
    fig.legend(handles=handles, loc="outside lower center", ncols=columns)
    add_title(fig, "paper-1", "Table II, with Wilson's 95 % intervals")
    return fig


def _sign(marker: str, face: str | None) -> dict[str, Any]:
    """How a marker looks; `face` is its inside, by default its colour."""
    bar = marker == "|"
    sign: dict[str, Any] = {
        "linestyle": "",
        "marker": marker,
        "markersize": scaled(10 if bar else 5),
        "markeredgewidth": scaled(2 if bar else 1.2),
    }
    return sign if face is None else sign | {"markerfacecolor": face}


@themed
def beyond_chart(table: pd.DataFrame) -> Figure:
    """Success of every policy in several scenarios: a line a scenario, bars where not exact.

    Parameters
    ----------
    table : DataFrame
        With the columns scenario, policy, success_low, success_high.
    """
    names = list(dict.fromkeys(table["scenario"]))
    policies = list(dict.fromkeys(table["policy"]))
    fig, axes = figure(_shape(2.7 * len(names) + 5))
    looks = policy_styles(policies)
    for row in table.to_dict("records"):
        policy = str(row["policy"])
        place = policies.index(policy) - (len(policies) - 1) / 2
        height = names.index(row["scenario"]) + 0.66 * place / len(policies)
        low, high = row["success_low"], row["success_high"]
        mark = looks[policy]
        axes.plot([low, high], [height] * 2, color=mark.color, linewidth=scaled(4), alpha=0.45)
        axes.plot(
            (low + high) / 2,
            height,
            color=mark.color,
            linestyle="",
            marker=mark.marker,
            label=policy if row["scenario"] == names[0] else None,
        )
    axes.set_yticks(range(len(names)), [_broken(name) for name in names])
    axes.set(xlim=(-0.03, 1.03), ylim=(len(names) - 0.5, -0.5), xlabel="success probability")
    _rows(axes, len(names))
    fig.legend(loc="outside lower center", ncols=3)
    add_title(fig, "success with other guides and in other scenarios")
    return fig


@themed
def sensitivity_chart(table: pd.DataFrame, intervals: Mapping[str, tuple[float, float]]) -> Figure:
    """Exact success where a geometry is moved a little, beside intervals to stay within.

    Parameters
    ----------
    table : DataFrame
        With the columns change and every policy of `intervals`.
    intervals : mapping
        Policy to (low, high), drawn as a band.
    """
    fig, some = panels(len(intervals), 1, _shape(2.0 * len(table) + 7), sharex=True, sharey=True)
    looks = policy_styles(intervals)
    heights = np.arange(len(table))
    for axes, (policy, (low, high)) in zip(some, intervals.items(), strict=True):
        mark = looks[policy]
        axes.axvspan(low, high, color=mark.color, alpha=0.15, linewidth=0)
        axes.axvline(float(table[policy].iloc[0]), color=INK, linewidth=scaled(0.8), linestyle=":")
        axes.plot(table[policy], heights, color=mark.color, marker=mark.marker, linestyle="")
        axes.set_title(policy)
        _rows(axes, 0)
    some[0].set_yticks(heights, [_broken(change) for change in table["change"]])
    some[0].set(xlim=(0.15, 0.85), ylim=(len(table) - 0.5, -0.5), xticks=[0.2, 0.4, 0.6, 0.8])
    fig.supxlabel(
        fill("exact success; shaded: Wilson's 95 % interval of the paper's 50 runs", _letters()),
        fontsize="medium",
    )
    add_title(fig, "paper-1", "small changes")
    return fig


@themed
def infeasible_chart(table: pd.DataFrame) -> Figure:
    """Members alive at every step, and how many of them have an empty constraint set.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, step, alive and short.
    """
    policies = list(dict.fromkeys(table["policy"]))
    narrow = current_theme().width < 5
    across, rows = (1, len(policies)) if narrow else (len(policies), 1)
    shape = 0.5 * len(policies) + 0.15 if narrow else None
    fig, some = panels(across, rows, shape, sharex=True, sharey=True)
    looks = policy_styles(policies)
    for axes, policy in zip(some, policies, strict=True):
        own = table[table["policy"] == policy]
        axes.bar(own["step"], own["short"], color=looks[str(policy)].color, width=0.8)
        axes.step(own["step"], own["alive"], where="mid", color=INK)
        axes.set(title=str(policy), xlabel="step", ylabel="members, mean")
        axes.set_ylim(0, 1.1 * float(table["alive"].max()))
        axes.label_outer()
        despine(axes)
    handles = [
        Line2D([], [], color=INK, label="alive"),
        Line2D([], [], color=GREY, linewidth=scaled(5), label="with an empty constraint set"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=2)
    add_title(fig, "members whose constraint set is empty")
    return fig


def _shape(lines: float) -> float:
    """Height over width of a figure as high as so many lines of its letters."""
    chosen = current_theme()
    return lines * 1.2 * chosen.letters / 72 / chosen.width


def _letters() -> int:
    """How many letters fit beside each other."""
    chosen = current_theme()
    return int(72 * chosen.width / (0.58 * chosen.letters))


def _broken(name: object) -> str:
    """The name of a line, broken where it would take more than a third of the width."""
    words = str(name).replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}")
    return fill(words, max(18, _letters() * 3 // 8), break_long_words=False)


def _rows(axes: Axes, number: int) -> None:
    """A frame and a grid for lines of symbols, with rules between so many lines."""
    despine(axes)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.grid(axis="x", color="#dddddd")
    for place in range(1, number):
        axes.axhline(place - 0.5, color="#dddddd", linewidth=scaled(0.6))

"""Figures of the paper reproduced: its tables as pictures, and how its method converges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..guide import Guide
from ..scenario import Scenario
from .maps import _finish, _map
from .style import BLUE, GREEN, INK, MEMBERS, ORANGE, POLICIES, SKY, VERMILION, figure, panels, tidy

_SYMBOLS = {"naive": "s", "constrained": "D", "leader": "o"}


def guides_map(scenario: Scenario, guides: Sequence[Guide], title: str = "") -> Figure:
    """Every member's own guide over the map of a lone member's rates.

    Members often share a path: the first is drawn widest and lowest, so that all stay visible.
    """
    fig, axes = _map(scenario, [guide.positions for guide in guides])
    for place, guide in enumerate(guides):
        width = 1.0 + 1.1 * (len(guides) - 1 - place)
        axes.plot(
            *guide.positions.T,
            color=MEMBERS[place % len(MEMBERS)],
            marker="o",
            markersize=width + 1.6,
            linewidth=width,
            solid_capstyle="round",
            zorder=4,
            label=f"member {place + 1}: {guide.survival:.3f}, step {guide.arrival}",
        )
    starts = np.array([guide.positions[0] for guide in guides])
    axes.plot(
        *starts.T,
        linestyle="",
        marker="o",
        markersize=5,
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=6,
        label="start",
    )
    _finish(fig, axes, title or f"{scenario.name}: every member's own guide")
    return fig


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
    fig, axes = figure(7.0, 3.6)
    kinds = (
        ("paper", f"the paper, {few} runs", ORANGE, "s"),
        (f"runs_{few}", f"casswarm, {few} runs", SKY, "^"),
        (f"runs_{runs}", f"casswarm, {runs:,} runs", GREEN, "D"),
        ("exact", "casswarm, exact", INK, "|"),
    )
    for row, (_, values) in enumerate(table.iterrows()):
        for place, (column, label, color, marker) in enumerate(kinds):
            low, high = float(values[f"{column}_low"]), float(values[f"{column}_high"])
            middle = (low + high) / 2 if column == "exact" else float(values[column])
            height = row + 0.18 * (place - 1.5)
            axes.plot([low, high], [height] * 2, color=color, linewidth=2.2, solid_capstyle="butt")
            size = 13 if marker == "|" else 6
            axes.plot(
                middle,
                height,
                color=color,
                marker=marker,
                markersize=size,
                markeredgewidth=2.2 if marker == "|" else 0,
                linestyle="",
                label=label if row == 0 else None,
            )
            axes.annotate(
                f"{middle:.2f}" if column in ("paper", f"runs_{few}") else f"{middle:.3f}",
                (max(high, middle), height),
                (7, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
                color=INK,
            )
    axes.set_yticks(range(len(table)), [str(name) for name in table["policy"]])
    axes.set(xlim=(0.1, 0.9), xlabel="success probability, scenario I (bars: Wilson 95 %)")
    axes.invert_yaxis()
    tidy(axes)
    axes.grid(axis="x", color="#dddddd", linewidth=0.6)
    axes.grid(axis="y", visible=False)
    axes.legend(loc="upper right", frameon=False, fontsize=9)
    return fig


def beyond_chart(table: pd.DataFrame) -> Figure:
    """Success of every policy in several scenarios: a line a scenario, bars where not exact.

    Parameters
    ----------
    table : DataFrame
        With the columns scenario, policy, success_low, success_high.
    """
    names = list(dict.fromkeys(table["scenario"]))
    fig, axes = figure(7.2, 1.2 + 0.46 * len(names))
    policies = list(dict.fromkeys(table["policy"]))
    for _, row in table.iterrows():
        policy = str(row["policy"])
        place = policies.index(policy)
        height = names.index(row["scenario"]) + 0.2 * (place - (len(policies) - 1) / 2)
        low, high = float(row["success_low"]), float(row["success_high"])
        color = POLICIES.get(policy, MEMBERS[place % len(MEMBERS)])
        axes.plot([low, high], [height] * 2, color=color, linewidth=5, alpha=0.45)
        axes.plot(
            (low + high) / 2,
            height,
            color=color,
            marker=_SYMBOLS.get(policy, "o"),
            markersize=6,
            linestyle="",
            label=policy if row["scenario"] == names[0] else None,
        )
    for place in range(1, len(names)):
        axes.axhline(place - 0.5, color="#dddddd", linewidth=0.6)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(-0.03, 1.03), ylim=(len(names) - 0.5, -0.5), xlabel="success probability")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    fig.legend(loc="outside upper center", ncols=3, frameon=False)
    return fig


def sensitivity_chart(table: pd.DataFrame, intervals: Mapping[str, tuple[float, float]]) -> Figure:
    """Exact success where a geometry is moved a little, beside intervals to stay within.

    Parameters
    ----------
    table : DataFrame
        With the columns change and every policy of `intervals`.
    intervals : mapping
        Policy to (low, high), drawn as a band.
    """
    fig, some = panels(len(intervals), 1, 2.5, 4.4)
    for axes, (policy, (low, high)) in zip(some, intervals.items(), strict=True):
        axes.axvspan(low, high, color=POLICIES[policy], alpha=0.15, linewidth=0)
        heights = np.arange(len(table))
        axes.axvline(float(table[policy].iloc[0]), color=INK, linewidth=0.8, linestyle=":")
        axes.plot(
            table[policy],
            heights,
            color=POLICIES[policy],
            marker=_SYMBOLS[policy],
            markersize=6,
            linestyle="",
        )
        axes.set_yticks(heights, list(table["change"]) if axes is some[0] else [""] * len(table))
        axes.tick_params(axis="y", length=0)
        axes.set(xlim=(0.15, 0.85), ylim=(len(table) - 0.5, -0.5), title=policy)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    fig.supxlabel(
        "exact success probability; shaded: Wilson 95 % of the paper's 50 runs", fontsize=10
    )
    return fig


def convergence_chart(
    guide: pd.DataFrame,
    formations: pd.DataFrame,
    references: Mapping[str, float],
) -> Figure:
    """The projected gradient on the guide and on formations: how far off, and how stationary.

    Parameters
    ----------
    guide : DataFrame
        With the columns iteration, survival and residual.
    formations : DataFrame
        With the columns problems, iteration, gap_median and residual_median.
    references : mapping
        Name to the survival that other guides have.
    """
    fig, (survival, residual, gap, formation_residual) = panels(2, 2, 4.3, 3.2)
    survival.plot(guide["iteration"], guide["survival"], color=BLUE, linewidth=2, marker="o", ms=4)
    for place, (name, value) in enumerate(references.items()):
        survival.axhline(value, color=INK, linewidth=1.2, linestyle=("--", ":")[place % 2])
        survival.annotate(f"{name}: {value:.3g}", (1, value), (0, 4), textcoords="offset points")
    survival.set(title="guide: survival of a lone member", yscale="log", ylim=(5e-5, 3))
    residual.plot(guide["iteration"], guide["residual"], color=BLUE, linewidth=2, marker="o", ms=4)
    residual.set(title="guide: stationarity residual", yscale="log", ylim=(1e-5, 1e-2))
    for place, (kind, rows) in enumerate(formations.groupby("problems", sort=False)):
        color, style = MEMBERS[place % len(MEMBERS)], ("-", "--", "-.", ":")[place % 4]
        for axes, column in ((gap, "gap_median"), (formation_residual, "residual_median")):
            median = rows[column].clip(lower=1e-9)
            axes.plot(
                rows["iteration"],
                median,
                color=color,
                linestyle=style,
                linewidth=2,
                label=str(kind),
            )
    gap.set(title="formation: gap to the best known, median", yscale="log")
    formation_residual.set(title="formation: stationarity residual, median", yscale="log")
    formation_residual.legend(frameon=False, fontsize=8)
    for axes in (survival, residual, gap, formation_residual):
        _iterations(axes)
    return fig


def _iterations(axes: Axes) -> None:
    axes.set_xscale("symlog", linthresh=1)
    axes.set_xlim(0, 1e4)
    axes.set_xlabel("iteration")
    axes.title.set_fontsize(10)
    tidy(axes)


def shortfall_chart(table: pd.DataFrame) -> Figure:
    """Members alive at every step, and how many of them have an empty constraint set.

    Parameters
    ----------
    table : DataFrame
        With the columns policy, step, alive and short.
    """
    policies = list(dict.fromkeys(table["policy"]))
    fig, some = panels(len(policies), 1, 4.2, 3.2)
    for axes, policy in zip(some, policies, strict=True):
        rows = table[table["policy"] == policy]
        axes.bar(rows["step"], rows["short"], color=VERMILION, width=0.8, label="with an empty set")
        axes.step(rows["step"], rows["alive"], where="mid", color=INK, linewidth=1.6, label="alive")
        axes.set(title=policy, xlabel="step", ylim=(0, 5.6))
        axes.title.set_fontsize(11)
        tidy(axes)
    some[0].set_ylabel("members, mean")
    entries = some[0].get_legend_handles_labels()
    fig.legend(*entries, loc="outside lower center", ncols=2, frameon=False)
    return fig

"""Policies against each other, and against what none can exceed, over several scenarios."""

from __future__ import annotations

import math

import pandas as pd
from matplotlib.figure import Figure

from .style import GREY, add_title, panels, policy_styles, scaled, themed

_COLUMNS = 3  # of panels, at the most


@themed
def policy_comparison_chart(table: pd.DataFrame, title: str = "") -> Figure:
    """Success of every policy, a panel a scenario; a dashed line is the bound for every policy.

    Parameters
    ----------
    table : DataFrame
        A row a scenario and policy: scenario, policy, success_low, success_high, bound.
    title : str
    """
    scenarios = list(dict.fromkeys(table["scenario"]))
    policies = list(dict.fromkeys(table["policy"]))
    looks = policy_styles(policies)
    columns = min(_COLUMNS, len(scenarios))
    rows = math.ceil(len(scenarios) / columns)
    height = rows * (0.1 + 0.028 * len(policies))
    fig, axes = panels(columns, rows, height, sharex=True, sharey=True)
    for panel, scenario in zip(axes, scenarios, strict=False):
        mine = table[table["scenario"] == scenario].set_index("policy")
        for place, policy in enumerate(policies):
            if policy not in mine.index:
                continue
            low, high = (float(mine.loc[policy, f"success_{end}"]) for end in ("low", "high"))
            mark, middle = looks[policy], (low + high) / 2
            panel.hlines(place, 0.0, middle, color=mark.color, lw=scaled(0.8), alpha=0.5)
            panel.errorbar(
                middle,
                place,
                xerr=[[middle - low], [high - middle]],
                color=mark.color,
                marker=mark.marker,
                markersize=scaled(3.5),
                linestyle="",
                capsize=scaled(2.5),
            )
        bound = float(mine["bound"].iloc[0])
        panel.axvline(bound, color=GREY, linestyle="--", lw=scaled(1.0), zorder=0)
        panel.set_title(f"{scenario}\nno policy exceeds {bound:.3f}", fontsize="small")
        panel.set(xlim=(0.0, 1.03), ylim=(len(policies) - 0.4, -0.6))
        panel.set_yticks(range(len(policies)), policies)
        panel.grid(axis="x", color="#dddddd")
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
    for panel in axes[len(scenarios) :]:
        panel.remove()
    for panel in axes[max(0, len(scenarios) - columns) : len(scenarios)]:
        panel.set_xlabel("success probability")
        panel.tick_params(labelbottom=True)
    add_title(fig, title)
    return fig

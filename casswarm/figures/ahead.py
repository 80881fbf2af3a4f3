"""What looking ahead buys: success and shortfalls over the number of steps in view."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .style import MEMBERS, POLICIES, panels, tidy


def look_ahead_chart(table: pd.DataFrame, title: str = "") -> Figure:
    """Success (above) and shortfalls (below) over the look-ahead, a column a scenario.

    Parameters
    ----------
    table : DataFrame
        A row a scenario, policy and look-ahead: scenario, policy, look_ahead, success,
        success_low, success_high, shortfalls (of a run, in member-steps).
    title : str
    """
    scenarios = list(dict.fromkeys(table["scenario"]))
    policies = list(dict.fromkeys(table["policy"]))
    fig, axes = panels(len(scenarios), 2, 2.3, 2.3)
    for column, scenario in enumerate(scenarios):
        above, below = axes[column], axes[len(scenarios) + column]
        for place, policy in enumerate(policies):
            mine = (table["scenario"] == scenario) & (table["policy"] == policy)
            rows = table[mine].sort_values("look_ahead")
            x = rows["look_ahead"].to_numpy(float)
            y = rows["success"].to_numpy(float)
            low, high = rows["success_low"].to_numpy(float), rows["success_high"].to_numpy(float)
            look: dict[str, Any] = {
                "color": POLICIES.get(policy, MEMBERS[place % len(MEMBERS)]),
                "marker": "osD^v"[place % 5],
                "markersize": 4,
                "linewidth": 1.3,
            }
            above.errorbar(
                x,
                y,
                [(y - low).clip(min=0.0), (high - y).clip(min=0.0)],
                capsize=2,
                label=policy,
                **look,
            )
            below.plot(x, rows["shortfalls"].to_numpy(float), **look)
        above.set_title(scenario, fontsize=10)
        above.set_ylim(-0.03, 1.03)
        below.set_ylim(bottom=0.0)
        steps = sorted(set(table["look_ahead"]))
        for panel in (above, below):
            panel.set_xticks(steps, [f"{step:g}" for step in steps])
            tidy(panel)
        below.set_xlabel("steps in view, H")
    axes[0].set_ylabel("success probability")
    axes[len(scenarios)].set_ylabel("shortfalls a run")
    axes[0].legend(frameon=False, fontsize=8, loc="lower right")
    fig.suptitle(title, fontsize=11)
    return fig

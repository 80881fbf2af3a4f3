"""Success and infeasibility of MPC policies over their horizons."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from .policy_styles import policy_styles
from .style import add_title, current_theme, despine, format_value, panels, themed
from .sweeps import success_line


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
    fig, axes = panels(
        2 * bands * across, across, 1.25 * bands / max(2, across) + 0.12, sharex=True
    )
    styles = policy_styles(table["policy"])
    for number in range(bands * across):
        band, column = divmod(number, across)
        upper, lower = (axes[(2 * band + row) * across + column] for row in (0, 1))
        if number >= len(scenarios):
            upper.set_visible(False)
            lower.set_visible(False)
            continue
        rows_here = table[table["scenario"] == scenarios[number]].sort_values("horizon")
        for policy, rows in rows_here.groupby("policy", sort=False):
            style = styles[str(policy)].line
            success_line(upper, rows, "horizon", horizons, style | {"label": str(policy)})
            lower.plot(rows["horizon"].to_numpy(float), rows["infeasible"], **style)
        upper.set(title=str(scenarios[number]), ylim=(-0.03, 1.03))
        lower.set_ylim(bottom=0.0)
        if column == 0:
            upper.set_ylabel("success")
            lower.set_ylabel("infeasible\nmember-steps")
        if number + across >= len(scenarios):  # the lowest of its column
            lower.tick_params(labelbottom=True)
            lower.set_xlabel("MPC horizon")
        for panel in (upper, lower):
            panel.set_xticks(horizons, [format_value(horizon) for horizon in horizons])
            despine(panel)
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=min(3, len(labels)))
    add_title(fig, title)
    return fig

"""What looking ahead buys: success and shortfalls over the number of steps in view."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from .style import add_title, current_theme, despine, format_value, panels, policy_styles, themed
from .sweeps import success_line


@themed
def mpc_chart(table: pd.DataFrame, title: str = "") -> Figure:
    """Success (above) and shortfalls (below) over the look-ahead, a column a scenario.

    Parameters
    ----------
    table : DataFrame
        A row a scenario, policy and look-ahead: scenario, policy, horizon, success,
        success_low, success_high, shortfalls (of a run, in member-steps).
    title : str
    """
    scenarios = list(dict.fromkeys(table["scenario"]))
    steps = sorted(set(table["horizon"]))
    across = min(len(scenarios), 2 if current_theme().width < 5 else 3)
    bands = -(-len(scenarios) // across)  # of two rows of panels
    shape = 1.25 * bands / max(2, across) + 0.12
    fig, places = panels(across, 2 * bands, shape, sharex=True)
    looks = policy_styles(table["policy"])
    for number in range(bands * across):
        band, column = divmod(number, across)
        above, below = (places[(2 * band + row) * across + column] for row in (0, 1))
        if number >= len(scenarios):
            above.set_visible(False)
            below.set_visible(False)
            continue
        own = table[table["scenario"] == scenarios[number]]
        for policy, rows in own.sort_values("horizon").groupby("policy", sort=False):
            mark = looks[str(policy)]
            look = {"color": mark.color, "marker": mark.marker, "linestyle": mark.dashes}
            success_line(above, rows, "horizon", steps, look, str(policy))
            below.plot(rows["horizon"].to_numpy(float), rows["infeasible"], **look)
        above.set(title=str(scenarios[number]), ylim=(-0.03, 1.03))
        below.set_ylim(bottom=0.0)
        if column == 0:
            above.set_ylabel("success")
            below.set_ylabel("infeasible")
        if number + across >= len(scenarios):  # the lowest of its column
            below.tick_params(labelbottom=True)
            below.set_xlabel("steps in view")
        for axes in (above, below):
            axes.set_xticks(steps, [format_value(step) for step in steps])
            despine(axes)
    handles, labels = places[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=min(3, len(labels)))
    add_title(fig, title)
    return fig

"""Success by policy."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from .style import INK, MEMBERS, POLICIES, figure, tidy


def success_chart(summary: pd.DataFrame, title: str = "") -> Figure:
    """Success probability of every policy with its interval.

    Parameters
    ----------
    summary : DataFrame
        With the columns policy, runs, success, success_low, success_high.
    title : str
    """
    fig, axes = figure(1.6 + 1.5 * max(2, len(summary)), 4.2)
    for place, row in enumerate(summary.to_dict("records")):
        color = POLICIES.get(str(row["policy"]), MEMBERS[place % len(MEMBERS)])
        below, above = row["success"] - row["success_low"], row["success_high"] - row["success"]
        axes.bar(place, row["success"], width=0.55, color=color, alpha=0.85)
        axes.errorbar(
            place,
            row["success"],
            [[max(0.0, below)], [max(0.0, above)]],
            color=INK,
            capsize=6,
            linewidth=1.4,
        )
        axes.annotate(
            f"{row['success']:.3f}",
            (place, row["success_high"]),
            (0, 5),
            textcoords="offset points",
            ha="center",
            fontsize=10,
        )
    axes.set_xticks(range(len(summary)), [str(name) for name in summary["policy"]])
    axes.set(ylim=(0, 1.08), xlim=(-0.6, len(summary) - 0.4), ylabel="success probability")
    runs = int(summary["runs"].min())
    axes.set_title(f"{title}\n{runs:,} runs each; bars: Wilson 95 % intervals".strip(), fontsize=11)
    tidy(axes)
    return fig

"""Success by policy, and differences between policies."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from .style import INK, add_title, despine, figure, policy_styles, scaled, themed


@themed
def success_chart(summary: pd.DataFrame, title: str = "") -> Figure:
    """Success probability of every policy with its interval or bracket.

    Parameters
    ----------
    summary : DataFrame
        With the columns policy, success_low, success_high; and runs and success where they were
        sampled. Brackets and intervals without a success (of exact laws, or of estimates of which
        a part is sampled) are drawn as bars up to their low end, and a line to the high one.
    title : str
    """
    fig, axes = figure()
    looks = policy_styles(summary["policy"])
    sampled = "success" in summary
    for place, row in enumerate(summary.to_dict("records")):
        low, high = row["success_low"], row["success_high"]
        height = row["success"] if sampled else low
        mark = looks[str(row["policy"])]
        axes.bar(place, height, width=0.55, color=mark.color, alpha=0.85)
        error = [[max(0.0, height - low)], [max(0.0, high - height)]]
        axes.errorbar(place, height, error, color=INK, capsize=scaled(5), linewidth=scaled(1.3))
        text = f"{height:.3f}" if sampled else _bracket(low, high)
        axes.annotate(text, (place, high), (0, scaled(4)), textcoords="offset points", ha="center")
    names = [str(name).replace("-", "-\n", 1) for name in summary["policy"]]
    axes.set_xticks(range(len(summary)), names, fontsize="medium")
    axes.set(ylim=(0, 1.08), xlim=(-0.6, len(summary) - 0.4), ylabel="success probability")
    axes.set_yticks(np.arange(6) / 5)
    told = "exact law, brackets"
    if "runs" in summary:
        runs = f"{int(summary['runs'].min()):,} runs each"
        told = f"{runs}, 95 % intervals" if sampled else f"{runs} beyond what is exact, intervals"
    add_title(fig, title, told)
    despine(axes)
    return fig


@themed
def difference_chart(paired: pd.DataFrame, title: str = "") -> Figure:
    """Differences in success between policies, run by run, with their 95 % intervals.

    Parameters
    ----------
    paired : DataFrame
        As `casswarm.studies.tables.paired_table` makes it.
    title : str
    """
    fig, axes = figure(min(1.2, (0.9 + 0.32 * len(paired)) / 4))
    rows = np.arange(len(paired))[::-1]
    middle = paired["difference"].to_numpy(float)
    low, high = (paired[f"difference_{end}"].to_numpy(float) for end in ("low", "high"))
    error = [np.maximum(0.0, middle - low), np.maximum(0.0, high - middle)]
    axes.axvline(0.0, color=INK, linewidth=scaled(0.8), zorder=1)
    axes.errorbar(middle, rows, xerr=error, fmt="o", color=INK, capsize=scaled(4), zorder=3)
    names = [f"{a} − {b}" for a, b in zip(paired["first"], paired["second"], strict=True)]
    axes.set_yticks(rows, names, fontsize="medium")
    ends = np.array([min(-0.02, low.min()), max(0.02, high.max())])
    axes.set(xlim=ends + 0.08 * np.ptp(ends) * np.array([-1, 1]), ylim=(-0.7, len(paired) - 0.3))
    axes.set_xlabel("difference in success probability,\n95 % interval")
    add_title(fig, title, "on the same random numbers, run by run")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#dddddd")
    axes.set_axisbelow(True)
    return fig


def _bracket(low: float, high: float) -> str:
    """A bracket as digits that are certain, both ends where they differ in the fourth."""
    return f"{low:.4f}" if f"{low:.4f}" == f"{high:.4f}" else f"{low:.4f}\nto {high:.4f}"

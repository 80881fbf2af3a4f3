"""Ranks of solvers with error bars."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from .performance_profiles import solver_style
from .style import add_title, current_theme, despine, marker, scaled, single_panel, themed


@themed
def ranking_chart(ranking: pd.DataFrame, title: str = "", order: Sequence[str] = ()) -> Figure:
    """Mean times with 95 % intervals, and the probability of every rank: a row per solver.

    Parameters
    ----------
    ranking : DataFrame
        Of one family and start, from `casswarm.comparison.ranking`, the best first.
    title : str
    order : sequence of str
        All solvers, so that each has the same colour in all figures.
    """
    names = list(order) or list(ranking["solver"])
    fig, axes = single_panel(current_theme().aspect_of(6 + 1.7 * len(ranking)))
    for y, row in enumerate(ranking.to_dict("records")):
        color = solver_style(names.index(row["solver"]))["color"]
        ends = row["mean_ms_low"], row["mean_ms_high"]
        if np.isfinite(ends).all():
            axes.plot(ends, [y, y], color=color, lw=scaled(2.2), solid_capstyle="butt")
        axes.plot(row["mean_ms"], y, **marker("o", 6, color, "white"))
        text = _rank_text(row["rank"], row["probability"])
        axes.annotate(
            text, (1.02, y), xycoords=("axes fraction", "data"), va="center", fontsize="small"
        )
    axes.set_yticks(range(len(ranking)), list(ranking["solver"]))
    axes.set_ylim(len(ranking) - 0.4, -0.6)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 1e3 * low else (1,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("mean solve time in ms, with 95 % interval")
    despine(axes, "x")
    add_title(fig, title)
    return fig


def _rank_text(rank: float, probability: float) -> str:
    text = f"rank {rank:g}"
    return text if np.isnan(probability) else f"{text} ({100 * probability:.0f} %)"

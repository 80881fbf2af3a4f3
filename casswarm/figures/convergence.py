"""Convergence of solvers on a problem: gap to the best known objective."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from .performance_profiles import solver_style
from .style import GREY, add_title, current_theme, despine, marker, panels, scaled, themed, wrap

_LIMITS = 1e-12, 1e12
"""Smallest and largest gaps that are drawn; others are drawn there."""


@themed
def gap_chart(
    iterates: pd.DataFrame, title: str = "", order: Sequence[str] = (), missing: Sequence[str] = ()
) -> Figure:
    """Relative gap to the best known objective, over iterations and over time.

    Feasible iterates are filled markers, infeasible ones hollow.

    Parameters
    ----------
    iterates : DataFrame
        Columns solver, iteration, seconds, gap and feasible: see
        `casswarm.comparison.convergence.Convergence`.
    title : str
    order : sequence of str
        All solvers, so that each has the same style in all figures.
    missing : sequence of str
        Solvers that took part and report no iterates.
    """
    names = list(order) or list(iterates["solver"].unique())
    theme = current_theme()
    across = 1 if theme.narrow else 2
    lines = 16 if across == 2 else 30
    fig, axes = panels(2, across, theme.aspect_of(lines + len(names) / 2), sharey=True)
    for panel, column, unit in zip(axes, ("iteration", "seconds"), (1.0, 1e3), strict=True):
        for name, part in iterates.groupby("solver", sort=False):
            _path(panel, unit * part[column], part, names.index(str(name)))
        panel.set_yscale("log")
        despine(panel)
        panel.set_ylabel("relative gap of the objective")
    axes[0].set_xscale("symlog", linthresh=1.0, linscale=0.5)
    axes[1].set_xscale("log")
    axes[0].set(xlabel="iteration", xlim=(0.0, None))
    axes[1].set(xlabel="time in ms")
    for panel in axes:
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes[1].xaxis.set_major_locator(LogLocator(numticks=7))
    axes[1].xaxis.set_minor_locator(NullLocator())
    if across == 2:
        axes[1].set_ylabel("")
    legend = _add_legend(fig, [n for n in names if n in set(iterates["solver"])], names)
    if missing:
        legend.set_title(wrap(f"without iterates: {', '.join(missing)}"))
    add_title(fig, title)
    return fig


def _path(axes: Axes, x: pd.Series, part: pd.DataFrame, number: int) -> None:
    """Draw the iterates of a solver."""
    style = solver_style(number)
    gap = part["gap"].clip(*_LIMITS).to_numpy(dtype=float)
    at, feasible = x.to_numpy(dtype=float), part["feasible"].to_numpy(dtype=bool)
    axes.plot(at, gap, color=style["color"], ls=style["linestyle"], lw=scaled(0.9))
    for shown, face in ((feasible, style["color"]), (~feasible, "white")):
        points = marker(style["marker"], 3.6, face, style["color"], 0.7)
        axes.plot(np.where(shown, at, np.nan), gap, **points)


def _add_legend(fig: Figure, drawn: Sequence[str], names: Sequence[str]) -> Legend:
    handles = [Line2D([], [], label=name, **solver_style(names.index(name))) for name in drawn]
    for label, face in (("feasible", GREY), ("infeasible", "white")):
        style = marker("o", 3.6, face, GREY, 0.7)
        handles.append(Line2D([], [], label=label, **style))
    columns = 2 if current_theme().narrow else 5
    return fig.legend(
        handles=handles,
        loc="outside lower center",
        ncols=columns,
        fontsize="small",
        title_fontsize="small",
    )

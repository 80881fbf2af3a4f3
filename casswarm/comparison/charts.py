"""Charts of a comparison: profiles, convergence, and ranks with error bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator, SymmetricalLogLocator

from .._util.figure_style import (
    GREY,
    INK,
    MEMBERS,
    AxesLike,
    DecadeTicks,
    add_legend,
    current_theme,
    despine,
    label_outer,
    label_panels,
    marker,
    panels,
    scaled,
    single_panel,
    themed,
    wrap,
)
from ..typing import FloatArray
from .ranking import rank_note

_COLORS = (*MEMBERS, INK, GREY)
_DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (7, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 1)))
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", "H", ">", "p")
_SPACING = 1.15  # of labels, in font sizes
_DECADES = 20  # maximum number of powers of two on an axis


@themed
def profile_chart(
    profiles: Mapping[str, pd.DataFrame],
    xlabel: str | Sequence[str],
    title: str | None = "",
    order: Sequence[str] = (),
    ylabel: str | Sequence[str] = "fraction of problems",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Performance, data or quality profiles, two side by side, labelled at the end of every curve.

    Parameters
    ----------
    profiles : mapping of panel title to DataFrame
        Fractions of problems, a column per solver; the index has the positive abscissas at which
        curves rise.
    xlabel, ylabel : str or sequence of str
        Of all panels, or of each.
    title, ax
        As in all `casswarm.figures`.
    order : sequence of str
        All solvers, so that each has the same style in all figures.
    """
    count = len(profiles)
    across = 1 if current_theme().narrow else min(2, count)
    aspect = 0.72 * count if across == 1 else (0.9 / across + 0.04) * -(-count // across)
    fig, axes = panels(count, across, aspect, title or "", ax)
    names = list(order) or list(next(iter(profiles.values())).columns)
    below, beside = ([text] * count if isinstance(text, str) else text for text in (xlabel, ylabel))
    for i, (panel, (name, profile)) in enumerate(zip(axes, profiles.items(), strict=True)):
        _curves(panel, profile, names)
        panel.set_title(wrap(name, 0.72 / across))
        panel.set(xlabel=below[i], ylabel=beside[i])
        if isinstance(xlabel, str):
            label_outer(panel)
    return fig


@themed
def pair_chart(
    profiles: Mapping[tuple[str, str], pd.DataFrame],
    title: str | None = "",
    order: Sequence[str] = (),
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Performance profiles of pairs of solvers, a panel per pair."""
    columns = min(2 if current_theme().narrow else 4, max(1, len(profiles)))
    aspect = min(0.6, 0.95 / columns + 0.08) * -(-len(profiles) // columns)
    fig, axes = panels(len(profiles), columns, aspect, title or "", ax)
    names = list(order) or sorted({name for pair in profiles for name in pair})
    for panel, profile in zip(axes, profiles.values(), strict=True):
        _curves(panel, profile, names, labels=False)
        panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), borderpad=0.1, labelspacing=0.2)
    label_panels(axes, "time relative to the faster of the two", "fraction of problems")
    return fig


@themed
def band_chart(
    profile: pd.DataFrame,
    bands: tuple[pd.DataFrame, pd.DataFrame],
    xlabel: str,
    title: str | None = "",
    order: Sequence[str] = (),
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """A profile with error bands: a panel per solver, in which the others are grey.

    Parameters
    ----------
    profile : DataFrame
        As in `profile_chart`.
    bands : DataFrame, DataFrame
        Lower and upper ends, of the same shape.
    xlabel, title, order, ax
        As in `profile_chart`.
    """
    theme = current_theme()
    columns = min(2 if theme.narrow else 3, len(profile.columns))
    rows = -(-len(profile.columns) // columns)
    aspect = (0.75 if columns > 1 else 0.5) / columns * rows + 0.06
    fig, axes = panels(
        len(profile.columns), columns, aspect, title or "", ax, sharex=True, sharey=True
    )
    names = list(order) or list(profile.columns)
    ends = [_steps(table) for table in (profile, *bands)]
    for column, (panel, name) in enumerate(zip(axes, profile.columns, strict=True)):
        (x, curves), (_, low), (_, high) = ends
        color = solver_style(names.index(str(name)))["color"]
        for other in np.delete(curves, column, axis=1).T:
            panel.step(x, other, where="post", color=GREY, lw=scaled(0.6), alpha=0.6)
        panel.fill_between(
            x, low[:, column], high[:, column], step="post", color=color, alpha=0.25, lw=0
        )
        panel.step(x, curves[:, column], where="post", color=color, lw=scaled(1.8))
        panel.set_title(str(name), color=color)
        _logarithmic(panel, x)
    for panel in axes[-columns:]:  # the last of each column
        panel.tick_params(labelbottom=True)
    label_panels(axes, xlabel, "fraction of problems")
    return fig


@themed
def win_chart(wins: pd.DataFrame, title: str | None = "", *, ax: AxesLike | None = None) -> Figure:
    """Fraction of problems for which the row's solver is faster than the column's, as a matrix."""
    size = len(wins)
    aspect = 0.18 + 0.394 * scaled() * size / current_theme().width
    fig, axes = single_panel(min(1.1, aspect), title or "", ax)
    values = wins.to_numpy(dtype=float)
    axes.imshow(np.nan_to_num(values), cmap="Blues", vmin=0, vmax=1.25, aspect="auto")
    fontsize = "small" if size <= 6 else "x-small"
    for row, column in np.argwhere(np.isfinite(values)):
        text = f"{100 * values[row, column]:.0f} %"
        color = "white" if values[row, column] > 0.7 else INK
        axes.text(column, row, text, ha="center", va="center", fontsize=fontsize, color=color)
    axes.set_xticks(range(size), list(wins.columns), rotation=30, ha="right")
    axes.set_yticks(range(size), list(wins.index))
    axes.set(xlabel="than this solver", ylabel="this solver is faster")
    return fig


def _curves(axes: Axes, profile: pd.DataFrame, names: Sequence[str], labels: bool = True) -> None:
    """Draw a step curve per solver."""
    x, fractions = _steps(profile)
    for column, name in enumerate(profile.columns):
        number = names.index(name)
        axes.step(
            x,
            fractions[:, column],
            where="post",
            # later curves are narrower, so that curves below them remain visible
            linewidth=scaled(2.8 - 1.7 * column / max(1, len(profile.columns) - 1)),
            # fractions of the axes, which differ between curves
            markevery=(0.03 + 0.021 * (number % 9), 0.19),
            label=name,
            **solver_style(number),
        )
    _logarithmic(axes, x)
    if labels and len(profile):
        _end_labels(axes, profile, names)


def _steps(profile: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Abscissas (K + 2,) and heights (K + 2, S) of a profile's curves, from zero on."""
    points, fractions = profile.index.to_numpy(dtype=float), profile.to_numpy(dtype=float)
    if not len(points):
        points, fractions = np.ones(1), np.zeros((1, len(profile.columns)))
    end = max(_axis_end(points[0], points[-1]), points[-1])
    x = np.concatenate([[0.93 * points[0]], points, [end]])
    return x, np.vstack([np.zeros_like(fractions[:1]), fractions, fractions[-1:]])


def _axis_end(first: float, last: float) -> float:
    """End of an axis with curves that rise between two points."""
    return max(2.0 * first, 1.3 * min(last, first * 2.0**_DECADES))


def _logarithmic(axes: Axes, x: FloatArray) -> None:
    """Axes of fractions over the abscissas of `_steps`."""
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_locator(LogLocator(base=2, numticks=6))
    axes.xaxis.set_major_formatter(FuncFormatter(partial(_power, axes)))
    axes.set(xlim=(x[0], _axis_end(x[1], x[-2])), ylim=(-0.02, 1.03))
    despine(axes)


def solver_style(number: int) -> dict[str, Any]:
    """Colour, dashes and marker of solver `number`: no two of the first 56 are the same."""
    return {
        "color": _COLORS[number % len(_COLORS)],
        "linestyle": _DASHES[number % len(_DASHES)],
        "marker": _MARKERS[number % len(_MARKERS)],
        "markersize": scaled(4.8),
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
    }


def _end_labels(axes: Axes, profile: pd.DataFrame, names: Sequence[str]) -> None:
    """Label the curves' ends with the solvers' names, moved apart where they would overlap."""
    ends = (profile.iloc[-1].to_numpy(dtype=float) + 0.02) / 1.05  # as fractions of the axes
    order = np.argsort(-ends, kind="stable")
    height = 72 * axes.bbox.height / axes.figure.dpi
    heights = _separated(ends[order], _SPACING * 0.83 * current_theme().font_size / height)
    options: dict[str, Any] = {"transform": axes.transAxes, "clip_on": False}
    for column, y in zip(order, heights, strict=True):
        name = str(profile.columns[column])
        style = solver_style(names.index(name))
        axes.plot([1.05, 1.09, 1.13], [y] * 3, markevery=[1], **options, **style)
        axes.text(1.15, y, name, va="center", fontsize="small", color=style["color"], **options)
        axes.plot([1.0, 1.045], [ends[column], y], color="#BBBBBB", lw=scaled(0.7), **options)


def _separated(heights: FloatArray, distance: float) -> FloatArray:
    """Descending heights, moved down to be `distance` apart, and up again where that is below 0."""
    offsets = distance * np.arange(len(heights))
    lowest = distance * (len(heights) - 1)
    return np.asarray(np.maximum(np.minimum.accumulate(heights + offsets), lowest) - offsets)


def _power(axes: Axes, value: float, _: int) -> str:
    """Text of a power of two: a number if all of the axis are short."""
    low, high = axes.get_xlim()
    short = low > 0.2 and high < 2**11
    return f"{value:g}" if short else f"$2^{{{round(np.log2(value))}}}$"


_LIMITS = 1e-12, 1e12
"""Smallest and largest gaps that are drawn; others are drawn there."""


@themed
def gap_chart(
    iterates: pd.DataFrame,
    title: str | None = "",
    order: Sequence[str] = (),
    missing: Sequence[str] = (),
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Relative gap to the best known objective, over iterations and over time.

    Feasible iterates are filled markers, infeasible ones hollow.

    Parameters
    ----------
    iterates : DataFrame
        Columns solver, iteration, seconds, gap and feasible: see
        `casswarm.comparison.Convergence`.
    title, order, ax
        As in `profile_chart`.
    missing : sequence of str
        Solvers that took part and report no iterates.
    """
    names = list(order) or list(iterates["solver"].unique())
    theme = current_theme()
    across = 1 if theme.narrow else 2
    lines = 16 if across == 2 else 30
    fig, axes = panels(
        2, across, theme.aspect_of(lines + len(names) / 2), title or "", ax, sharey=True
    )
    for panel, column, unit in zip(axes, ("iteration", "seconds"), (1.0, 1e3), strict=True):
        for name, part in iterates.groupby("solver", sort=False):
            _path(panel, unit * part[column], part, names.index(str(name)))
        panel.set(yscale="log", ylabel="relative gap of the objective")
        despine(panel)
    axes[0].set_xscale("symlog", linthresh=1.0, linscale=0.5)
    axes[0].set(xlabel="iteration", xlim=(0.0, None))
    parts = (1.0, 2.0, 5.0) if axes[0].get_xlim()[1] < 50 else (1.0,)
    axes[0].xaxis.set_major_locator(SymmetricalLogLocator(base=10, linthresh=1, subs=parts))
    axes[1].set(xlabel="time in ms", xscale="log")
    for panel in axes:
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes[1].xaxis.set_major_locator(DecadeTicks())
    axes[1].xaxis.set_minor_locator(NullLocator())
    if across == 2:
        axes[1].set_ylabel("")
    legend = _add_legend(axes[-1], [n for n in names if n in set(iterates["solver"])], names)
    if missing:
        legend.set_title(wrap(f"without iterates: {', '.join(missing)}"))
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


def _add_legend(axes: Axes, drawn: Sequence[str], names: Sequence[str]) -> Legend:
    handles = [Line2D([], [], label=name, **solver_style(names.index(name))) for name in drawn]
    for label, face in (("feasible", GREY), ("infeasible", "white")):
        style = marker("o", 3.6, face, GREY, 0.7)
        handles.append(Line2D([], [], label=label, **style))
    style = {"fontsize": "small", "title_fontsize": "small"}
    columns = 2 if current_theme().narrow else 5
    return add_legend(axes, handles, columns, **style)


@themed
def ranking_chart(
    ranking: pd.DataFrame,
    title: str | None = "",
    order: Sequence[str] = (),
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Mean times with 95 % intervals, and the probability of every rank: a row per solver.

    Parameters
    ----------
    ranking : DataFrame
        Of one family and start, from `casswarm.comparison.ranking`, the best first.
    title, order, ax
        As in `profile_chart`.
    """
    names = list(order) or list(ranking["solver"])
    fig, axes = single_panel(current_theme().aspect_of(6 + 1.7 * len(ranking)), title or "", ax)
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
    axes.xaxis.set_major_locator(DecadeTicks())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    label, note = "mean solve time in ms, with 95 % interval", rank_note(ranking)
    axes.set_xlabel(f"{label}\n{wrap(note, 0.8)}" if note else label)
    despine(axes, "x")
    return fig


def _rank_text(rank: float, probability: float) -> str:
    text = f"rank {rank:g}"
    return text if np.isnan(probability) else f"{text} ({100 * probability:.0f} %)"

"""Profiles of solvers: step curves on a logarithmic axis, and who beats whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

from ..arrays import Floats
from .style import INK, MEMBERS, figure, panels, tidy

_COLORS = (*MEMBERS, INK, "#8C8C8C")
_DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (7, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 1)))
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", "H", ">", "p")
_ROOM = 0.062  # between two labels, in shares of the axis
_DECADES = 20  # powers of two that an axis shows at the most


def profile_chart(
    profiles: Mapping[str, pd.DataFrame], xlabel: str, title: str = "", order: Sequence[str] = ()
) -> Figure:
    """Profiles side by side, each curve labelled at its end.

    Parameters
    ----------
    profiles : mapping of panel title to DataFrame
        Index the points at which curves rise, above zero; a column a solver, shares of problems.
    xlabel, title : str
    order : sequence of str
        All solvers there are: gives each its colour, whoever takes part in a panel.
    """
    fig, axes = panels(len(profiles), 1, 5.8, 4.3)
    names = list(order) or list(next(iter(profiles.values())).columns)
    for place, (name, profile) in zip(axes, profiles.items(), strict=True):
        _curves(place, profile, names)
        place.set_title(name, fontsize=10)
        place.set_xlabel(xlabel)
    axes[0].set_ylabel("share of problems")
    fig.suptitle(title, fontsize=11)
    return fig


def pair_chart(
    profiles: Mapping[tuple[str, str], pd.DataFrame], title: str = "", order: Sequence[str] = ()
) -> Figure:
    """Performance profiles of pairs of solvers, a panel a pair."""
    columns = min(4, max(1, len(profiles)))
    fig, axes = panels(columns, -(-len(profiles) // columns), 3.3, 2.9)
    names = list(order) or sorted({name for pair in profiles for name in pair})
    for place, profile in zip(axes, profiles.values(), strict=False):
        _curves(place, profile, names, labels=False)
        place.legend(
            fontsize=8,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=2,
            frameon=False,
            handlelength=2.6,
        )
    for place in axes[len(profiles) :]:
        place.set_visible(False)
    fig.supxlabel("factor of the faster one of the two", fontsize=9)
    fig.supylabel("share of problems", fontsize=9)
    fig.suptitle(title, fontsize=11)
    return fig


def win_chart(wins: pd.DataFrame, title: str = "") -> Figure:
    """Share of problems in which the row's solver is faster than the column's, as a matrix."""
    size = len(wins)
    fig, axes = figure(2.4 + 0.75 * size, 1.6 + 0.55 * size)
    values = wins.to_numpy(dtype=float)
    axes.imshow(np.nan_to_num(values), cmap="Blues", vmin=0, vmax=1.25, aspect="auto")
    for row, column in np.argwhere(np.isfinite(values)):
        share = values[row, column]
        axes.text(
            column,
            row,
            f"{100 * share:.0f} %",
            ha="center",
            va="center",
            fontsize=9,
            color="white" if share > 0.7 else INK,
        )
    axes.set_xticks(range(size), list(wins.columns), rotation=30, ha="right", fontsize=9)
    axes.set_yticks(range(size), list(wins.index), fontsize=9)
    axes.set(xlabel="... than this one", ylabel="this one is faster ...")
    fig.suptitle(title, fontsize=11)
    return fig


def _curves(axes: Axes, profile: pd.DataFrame, names: Sequence[str], labels: bool = True) -> None:
    points = profile.index.to_numpy(dtype=float)
    first = points[0] if len(points) else 1.0
    last = min(points[-1] if len(points) else 1.0, first * 2.0**_DECADES)
    end = max(2.0 * first, last * 1.3)
    shares = profile.to_numpy(dtype=float)
    for column, name in enumerate(profile.columns):
        number = names.index(name)
        axes.step(
            np.concatenate(
                [[first * 0.93], points, [max(end, points[-1] if len(points) else end)]]
            ),
            np.concatenate([[0.0], shares[:, column], shares[-1:, column] if len(points) else [0]]),
            where="post",
            # what lies over others is drawn narrower, so that all are seen
            linewidth=3.2 - 2.0 * column / max(1, len(profile.columns) - 1),
            # in shares of the axes, so that no two curves have theirs at the same places
            markevery=(0.03 + 0.021 * (number % 9), 0.19),
            label=name,
            **_look(number),
        )
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_locator(LogLocator(base=2, numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(_power))
    axes.set(xlim=(first * 0.93, end), ylim=(-0.02, 1.03))
    tidy(axes)
    if labels and len(points):
        _end_labels(axes, profile, names)


def _look(number: int) -> dict[str, Any]:
    """Colour, dashes and marker of a solver: no two of the first 56 have all alike."""
    return {
        "color": _COLORS[number % len(_COLORS)],
        "linestyle": _DASHES[number % len(_DASHES)],
        "marker": _MARKERS[number % len(_MARKERS)],
        "markersize": 5.5,
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
    }


def _end_labels(axes: Axes, profile: pd.DataFrame, names: Sequence[str]) -> None:
    """Names at the right of the curves' ends, moved apart where they would overlap."""
    ends = profile.iloc[-1].to_numpy(dtype=float)
    order = np.argsort(-ends, kind="stable")
    places = _apart((ends[order] + 0.02) / 1.05)
    for column, place in zip(order, places, strict=True):
        name = str(profile.columns[column])
        look = _look(names.index(name))
        sample = axes.plot(
            [1.05, 1.09, 1.13], [place] * 3, transform=axes.transAxes, clip_on=False, **look
        )
        sample[0].set_markevery([1])
        axes.text(
            1.15,
            place,
            name,
            transform=axes.transAxes,
            color=look["color"],
            fontsize=9,
            va="center",
        )
        axes.plot(
            [1.0, 1.045],
            [(ends[column] + 0.02) / 1.05, place],
            color="#bbbbbb",
            linewidth=0.7,
            transform=axes.transAxes,
            clip_on=False,
        )


def _apart(places: Floats) -> Floats:
    """Falling places, moved down so that neighbours are `_ROOM` apart, and up again if too low."""
    moved = places.copy()
    for i in range(1, len(moved)):
        moved[i] = min(moved[i], moved[i - 1] - _ROOM)
    if len(moved) and moved[-1] < 0:
        moved[-1] = 0.0
        for i in range(len(moved) - 2, -1, -1):
            moved[i] = max(moved[i], moved[i + 1] + _ROOM)
    return moved


def _power(value: float, _: int) -> str:
    """A power of two, as a number where that is short."""
    exponent = round(np.log2(value))
    return f"{value:g}" if 0 <= exponent <= 10 else f"$2^{{{exponent}}}$"

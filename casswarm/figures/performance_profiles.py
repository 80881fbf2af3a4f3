"""Profiles of solvers: step curves on a logarithmic axis, and who beats whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

from ..typing import FloatArray
from .style import (
    GREY,
    INK,
    MEMBERS,
    add_title,
    current_theme,
    despine,
    figure,
    panels,
    scaled,
    themed,
)

_COLORS = (*MEMBERS, INK, GREY)
_DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (7, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 1)))
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", "H", ">", "p")
_ROOM = 1.15  # between two labels, in letters
_DECADES = 20  # powers of two that an axis shows at the most


@themed
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
    across = 1 if current_theme().width < 5 else len(profiles)
    down = -(-len(profiles) // across)
    fig, axes = panels(across, down, 0.72 * down if across == 1 else 0.9 / across + 0.04)
    names = list(order) or list(next(iter(profiles.values())).columns)
    for place, (name, profile) in zip(axes, profiles.items(), strict=True):
        _curves(place, profile, names)
        place.set_title(
            fill(name, int(90 * current_theme().width / current_theme().letters / across))
        )
        place.set_xlabel(xlabel)
        place.set_ylabel("share of problems")
        place.label_outer()
    add_title(fig, title)
    return fig


@themed
def pair_chart(
    profiles: Mapping[tuple[str, str], pd.DataFrame], title: str = "", order: Sequence[str] = ()
) -> Figure:
    """Performance profiles of pairs of solvers, a panel a pair."""
    columns = min(2 if current_theme().width < 5 else 4, max(1, len(profiles)))
    rows = -(-len(profiles) // columns)
    fig, axes = panels(columns, rows, min(0.6, 0.95 / columns + 0.08) * rows)
    names = list(order) or sorted({name for pair in profiles for name in pair})
    for place, profile in zip(axes, profiles.values(), strict=False):
        _curves(place, profile, names, labels=False)
        place.legend(
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=1,
            borderpad=0.1,
            labelspacing=0.2,
        )
    for place in axes[len(profiles) :]:
        place.set_visible(False)
    fig.supxlabel("factor of the faster one of the two", fontsize="medium")
    fig.supylabel("share of problems", fontsize="medium")
    add_title(fig, title)
    return fig


@themed
def win_chart(wins: pd.DataFrame, title: str = "") -> Figure:
    """Share of problems in which the row's solver is faster than the column's, as a matrix."""
    size = len(wins)
    fig, axes = figure(min(1.1, 0.18 + 0.055 * scaled() * size * 7.16 / current_theme().width))
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
            fontsize="small" if size <= 6 else "x-small",
            color="white" if share > 0.7 else INK,
        )
    axes.set_xticks(range(size), list(wins.columns), rotation=30, ha="right")
    axes.set_yticks(range(size), list(wins.index))
    axes.set(xlabel="... than this one", ylabel="this one is faster ...")
    add_title(fig, title)
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
            linewidth=scaled(2.8 - 1.7 * column / max(1, len(profile.columns) - 1)),
            # in shares of the axes, so that no two curves have theirs at the same places
            markevery=(0.03 + 0.021 * (number % 9), 0.19),
            label=name,
            **_look(number),
        )
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_locator(LogLocator(base=2, numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(_power))
    axes.set(xlim=(first * 0.93, end), ylim=(-0.02, 1.03))
    despine(axes)
    if labels and len(points):
        _end_labels(axes, profile, names)


def _look(number: int) -> dict[str, Any]:
    """Colour, dashes and marker of a solver: no two of the first 56 have all alike."""
    return {
        "color": _COLORS[number % len(_COLORS)],
        "linestyle": _DASHES[number % len(_DASHES)],
        "marker": _MARKERS[number % len(_MARKERS)],
        "markersize": scaled(4.8),
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
    }


def _end_labels(axes: Axes, profile: pd.DataFrame, names: Sequence[str]) -> None:
    """Names at the right of the curves' ends, moved apart where they would overlap."""
    ends = profile.iloc[-1].to_numpy(dtype=float)
    order = np.argsort(-ends, kind="stable")
    root = axes.get_figure(root=True)
    assert root is not None
    height = 72 * axes.get_position().height * root.get_figheight()
    places = _apart((ends[order] + 0.02) / 1.05, _ROOM * 0.83 * current_theme().letters / height)
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
            fontsize="small",
            va="center",
        )
        axes.plot(
            [1.0, 1.045],
            [(ends[column] + 0.02) / 1.05, place],
            color="#bbbbbb",
            linewidth=scaled(0.7),
            transform=axes.transAxes,
            clip_on=False,
        )


def _apart(places: FloatArray, room: float) -> FloatArray:
    """Falling places, moved down so that neighbours are `room` apart, and up again if too low."""
    moved = places.copy()
    for i in range(1, len(moved)):
        moved[i] = min(moved[i], moved[i - 1] - room)
    if len(moved) and moved[-1] < 0:
        moved[-1] = 0.0
        for i in range(len(moved) - 2, -1, -1):
            moved[i] = max(moved[i], moved[i + 1] + room)
    return moved


def _power(value: float, _: int) -> str:
    """A power of two, as a number where that is short."""
    exponent = round(np.log2(value))
    return f"{value:g}" if 0 <= exponent <= 10 else f"$2^{{{exponent}}}$"

"""The formation close up: who leads, who is lost, and how well they protect each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from .closeups import RELATIVE_RATE_NORM, Closeup, shades, window
from .style import BLUE, GREY, INK, add_title, current_theme, panels, scaled, themed


@themed
def formation_chart(
    scenario: Scenario,
    trace: RunTrajectory,
    guide: Guide | None = None,
    title: str = "",
    *,
    steps: Sequence[int] | None = None,
    corridors: bool = False,
) -> Figure:
    """The formation close up at some steps, around where the guide is then.

    Shades tell how well the swarm protects: the rate that one more member would have at a place, as
    a share of a lone member's. Members that stand together share a label.

    Parameters
    ----------
    scenario : Scenario
    trace : Trace
    guide : Guide, optional
        Its point is the middle of every panel; without it, the mean of the living is.
    title : str
    steps : sequence of int, optional
        By default the first and the last, those at which members are lost, and some between.
    corridors : bool
        Whether to draw the corridor around the guide.

    Raises
    ------
    ValueError
        A step beyond the end of the run.
    """
    across = _columns()
    number = 6 if across == 3 else 8
    chosen = representative_steps(trace, number) if steps is None else list(steps)
    if not chosen or min(chosen) < 0 or max(chosen) >= len(trace.alive):
        raise ValueError(f"steps = {chosen}; allowed: from 0 to {len(trace.alive) - 1}, at least 1")
    narrow = current_theme().width < 5
    columns = min(across, len(chosen))
    rows = -(-len(chosen) // columns)
    shape = 1.05 * rows / columns + 0.16 if narrow else 0.95 * rows / columns + 0.06
    fig, places = panels(columns, rows, shape, sharex=True, sharey=True)
    half = window(trace, guide)
    for axes, step in zip(places, chosen, strict=False):
        closeup = Closeup(axes, scenario, trace, guide, half, corridors)
        closeup.show(step)
        axes.set_title(caption(trace, step), fontsize="small")
        axes.label_outer()
    for axes in places[len(chosen) :]:
        axes.set_visible(False)
    side: dict[str, Any] = (
        {"location": "bottom", "pad": 0.015} if narrow else {"location": "right", "pad": 0.02}
    )
    mappable = ScalarMappable(RELATIVE_RATE_NORM, shades())
    bar = fig.colorbar(mappable, ax=places, extend="max", **side)
    bar.set_label("rate of one more member,\nas a share of a lone member's")
    handles = legend_handles(guide is not None, corridors, bool((trace.leaders >= 0).any()))
    fig.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else len(handles))
    add_title(
        fig,
        title or scenario.name,
        f"the formation around {'the guide' if guide else 'its middle'}",
    )
    return fig


def _columns() -> int:
    """Panels side by side whose captions have room."""
    chosen = current_theme()
    caption = 23 * 0.58 * 0.83 * chosen.letters / 72
    return max(2, min(4, int(0.86 * chosen.width / caption)))


def representative_steps(trace: RunTrajectory, number: int) -> list[int]:
    """The first and the last step, those of losses, and others between, as evenly as can be."""
    last = len(trace.alive) - 1
    losses = np.flatnonzero((trace.alive[:-1] & ~trace.alive[1:]).any(axis=1)) + 1
    if len(losses) > number - 2:
        losses = losses[np.linspace(0, len(losses) - 1, number - 2).round().astype(int)]
    chosen = {0, last, *map(int, losses)}
    while len(chosen) < min(number, last + 1):
        steps = sorted(chosen)
        gaps = np.diff(steps)
        widest = int(np.argmax(gaps))
        chosen.add(steps[widest] + int(gaps[widest]) // 2)
    return sorted(chosen)


def caption(trace: RunTrajectory, step: int) -> str:
    """What a step is: its number, and how many are alive."""
    return f"step {step}: {int(trace.alive[step].sum())} of {trace.alive.shape[1]} alive"


def legend_handles(guide: bool, corridors: bool, leads: bool) -> list[Line2D]:
    """What the signs of a close-up mean."""
    signs = {
        "leads": ("*", GREY, INK, 11) if leads else None,
        "alive": ("o", GREY, "white", 6.5),
        "lost in this step": ("X", "white", INK, 7.5),
        "guide": ("+", BLUE, BLUE, 9) if guide else None,
    }
    handles = [
        Line2D(
            [],
            [],
            linestyle="",
            marker=sign[0],
            color=sign[1],
            markeredgecolor=sign[2],
            markersize=scaled(sign[3]),
            label=name,
        )
        for name, sign in signs.items()
        if sign is not None
    ]
    if corridors:
        handles.append(Line2D([], [], color=BLUE, lw=scaled(0.8), label="corridor"))
    return handles

"""Formation at several steps of a run: leaders, losses, and mutual protection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from ..typing import BoolArray
from .closeups import Closeup, formation_centers, window
from .style import BLUE, GREY, add_title, current_theme, marker, panels, scaled, themed


@themed
def formation_chart(
    scenario: Scenario,
    trajectory: RunTrajectory,
    guide: Guide | None = None,
    title: str = "",
    *,
    steps: Sequence[int] | None = None,
    corridors: bool = False,
) -> Figure:
    """Close-ups of the formation at several steps, centred on the guide.

    Shades are the hazard rate that an additional agent would have, relative to an isolated agent:
    the lighter, the better the swarm protects. Members close to each other share a label.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
    guide : Guide, optional
        Centre of every panel; by default that is the mean of the members alive.
    title : str
    steps : sequence of int, optional
        By default the first and the last, those at which members are lost, and some in between.
    corridors : bool
        Whether to draw the corridor around the guide.

    Raises
    ------
    ValueError
        A step is beyond the end of the run.
    """
    narrow = current_theme().narrow
    across = max(2, min(4, int(current_theme().characters / 22)))  # captions fit
    if steps is None:
        steps = representative_steps(trajectory, 6 if across == 3 else 8)
    chosen = list(steps)
    last = len(trajectory.alive) - 1
    if not chosen or min(chosen) < 0 or max(chosen) > last:
        raise ValueError(f"steps = {chosen}; allowed: from 0 to {last}, at least 1")
    columns = min(across, len(chosen))
    shape = (1.05 if narrow else 0.95) * -(-len(chosen) // columns) / columns
    aspect = shape + (0.16 if narrow else 0.06)
    fig, axes = panels(len(chosen), columns, aspect, sharex=True, sharey=True)
    centers = formation_centers(trajectory, guide)
    half = window(trajectory, centers)
    what = {"marked": guide is not None, "corridors": corridors}
    for panel, step in zip(axes, chosen, strict=True):
        Closeup(panel, scenario, trajectory, centers, half, **what).show(step)
        panel.set_title(caption(step, trajectory.alive[step]), fontsize="small")
        panel.label_outer()
    fig.colorbar(
        axes[0].images[0],
        ax=axes,
        extend="max",
        location="bottom" if narrow else "right",
        pad=0.02,
        label="hazard rate\nrelative to an isolated agent",
    )
    handles = legend_handles(trajectory, guide is not None, corridors)
    fig.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else len(handles))
    center = "the guide" if guide else "its mean"
    add_title(fig, title or scenario.name, f"formation around {center}")
    return fig


def representative_steps(trajectory: RunTrajectory, number: int) -> list[int]:
    """First and last step, those of losses, and others in between, as evenly as possible."""
    last = len(trajectory.alive) - 1
    losses = np.flatnonzero((trajectory.alive[:-1] & ~trajectory.alive[1:]).any(axis=1)) + 1
    if len(losses) > number - 2:
        losses = losses[np.linspace(0, len(losses) - 1, number - 2).round().astype(int)]
    chosen = {0, last, *map(int, losses)}
    while len(chosen) < min(number, last + 1):
        steps = sorted(chosen)
        gaps = np.diff(steps)
        widest = int(np.argmax(gaps))
        chosen.add(steps[widest] + int(gaps[widest]) // 2)
    return sorted(chosen)


def caption(step: int, alive: BoolArray) -> str:
    """Number of a step, and of the members alive (n,) then."""
    return f"step {step}: {int(alive.sum())} of {len(alive)} alive"


def legend_handles(
    trajectory: RunTrajectory, guide: bool = False, corridors: bool = False
) -> list[Line2D]:
    """Handles of a legend of close-ups of a run."""
    styles = {"leader": marker("*", 11, GREY)} if (trajectory.leaders >= 0).any() else {}
    styles |= {"alive": marker("o", 6.5, GREY, "white"), "lost in this step": marker("X", 7.5)}
    if guide:
        styles["guide"] = marker("+", 9, edge=BLUE)
    edge = {"markeredgewidth": 1.0}  # the same in all themes
    handles = [Line2D([], [], label=label, **style | edge) for label, style in styles.items()]
    if corridors:
        handles.append(Line2D([], [], color=BLUE, lw=scaled(0.8), label="corridor"))
    return handles

"""Animation of a run: the members on the map, and a close-up of their formation."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from .base_map import add_landmarks, draw_field, extent, pixels, set_extent, single_agent_norm
from .closeups import (
    RELATIVE_RATE_NORM,
    RELATIVE_RATES,
    Closeup,
    additional_agent_rates,
    follows_guide,
    leader_at,
    window,
)
from .formations import caption, legend_handles
from .style import BLUE, INK, MEMBERS, VERMILION, current_theme, panels, scaled, settings, themed

_PIXELS = 110


def animate(
    scenario: Scenario,
    trajectory: RunTrajectory,
    guide: Guide | None = None,
    *,
    title: str = "",
    frames_per_second: float = 4.0,
) -> FuncAnimation:
    """Animate a run, a frame per step: positions, leaders, losses, and mutual protection.

    On the left a map of the hazard rate of an additional agent, given the positions of the members
    at that step; on the right a close-up of the formation, with that rate relative to an isolated
    agent. All scales are the same in every frame.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
        For instance ``study.trajectories["leader"][0]``.
    guide : Guide, optional
        Drawn on the map; if the swarm follows it, the close-up is centred on it.
    title : str
        By default the scenario's name.
    frames_per_second : float

    Returns
    -------
    matplotlib.animation.FuncAnimation
        In a notebook, ``HTML(casswarm.figures.player(animation))`` shows it; so does matplotlib's
        own ``to_jshtml``, which loads its icons from the network.

    Raises
    ------
    ValueError
        `frames_per_second` is not positive.
    """
    if not frames_per_second > 0:
        raise ValueError(f"frames_per_second = {frames_per_second!r}; allowed: above 0")
    shown = RunFigure(scenario, trajectory, guide, title or scenario.name)
    interval = 1000.0 / frames_per_second
    return FuncAnimation(
        shown.figure,
        shown.show,
        frames=len(trajectory.alive),
        init_func=lambda: [],
        interval=interval,
        repeat_delay=4 * interval,
        cache_frame_data=False,
    )


class RunFigure:
    """Figure with a map and a close-up that shows any step of a run.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
    guide : Guide or None
    title : str
    """

    def __init__(
        self, scenario: Scenario, trajectory: RunTrajectory, guide: Guide | None, title: str
    ) -> None:
        self.scenario, self.trajectory, self.guide = scenario, trajectory, guide
        self.title = title
        self.settings = settings(current_theme())
        self.few = trajectory.alive.shape[1] <= len(MEMBERS)
        self.artists: list[Artist] = []
        self.figure = self._build()

    @themed
    def _build(self) -> Figure:
        """Draw what all frames have in common."""
        trajectory, guide = self.trajectory, self.guide
        contents = [trajectory.positions.reshape(-1, 2)]
        if guide is not None:
            contents.append(guide.positions)
        low, high = extent(self.scenario, contents)
        self.nodes = pixels(low, high, _PIXELS)
        ratios = (1.0, (high[1] - low[1]) / (high[0] - low[0]))
        fig, (self.map, close) = panels(2, 2, 0.62, width_ratios=ratios)
        set_extent(self.map, low, high)
        norm = single_agent_norm(self.scenario, low, high)
        self.image = draw_field(self.map, np.full(self.nodes.shape[:2], norm.vmin), norm)
        add_landmarks(self.map, self.scenario)
        follows = guide is not None and follows_guide(
            trajectory, guide, self.scenario.formation.rho
        )
        center = guide if follows else None
        half = window(trajectory, center)
        self.closeup = Closeup(close, self.scenario, trajectory, center, half, corridors=False)
        close.set_ylabel("")
        scales: list[tuple[ScalarMappable, Axes, str]] = [
            (self.image, self.map, "hazard rate of an additional agent"),
            (
                ScalarMappable(RELATIVE_RATE_NORM, RELATIVE_RATES),
                close,
                "relative to an isolated agent",
            ),
        ]
        for mappable, axes, label in scales:
            fig.colorbar(mappable, ax=axes, label=label, extend="max", location="bottom", pad=0.02)
        handles = self.map.get_legend_handles_labels()[0]
        handles += legend_handles(False, False, bool((trajectory.leaders >= 0).any()))
        handles[-1].set_label("lost")
        if guide is not None:
            line: dict[str, Any] = {"color": INK, "linewidth": scaled(0.8), "linestyle": ":"}
            self.map.plot(*guide.positions.T, zorder=3, **line)
            handles.append(Line2D([], [], label="guide", **line))
        columns = 3 if current_theme().narrow else len(handles)
        fig.legend(handles=handles, loc="outside lower center", ncols=columns)
        self.heading = fig.suptitle(self._heading(0))
        return fig

    def show(self, step: int) -> list[Artist]:
        """Show a step."""
        with rc_context(self.settings):
            positions, alive = self.trajectory.positions[step], self.trajectory.alive[step]
            rates = additional_agent_rates(self.scenario.hazard, self.nodes, positions, alive)
            self.image.set_data(rates)
            self.closeup.show(step)
            self.heading.set_text(self._heading(step))
            for artist in self.artists:
                artist.remove()
            self.artists = []
            self._draw_members(step)
        return self.artists

    def _draw_members(self, step: int) -> None:
        """Draw the members with their paths so far, those destroyed as crosses."""
        alive, leader = self.trajectory.alive[step], leader_at(self.trajectory, step)
        ends = np.minimum(step, self.trajectory.last_steps())
        for member, end in enumerate(ends):
            color = MEMBERS[member] if self.few else BLUE
            path = self.trajectory.positions[: end + 1, member]
            self.artists += self.map.plot(*path.T, color=color, lw=scaled(0.9), alpha=0.7, zorder=4)
            leads, lost = member == leader, not alive[member]
            if lost or (leads and not self.few):
                color = "white" if lost else VERMILION
            self.artists += self.map.plot(
                *path[-1],
                marker="X" if lost else "*" if leads else "o",
                color=color,
                markeredgecolor=INK if leads or lost else "white",
                markeredgewidth=scaled(0.7),
                markersize=scaled(11 if leads else 6.5 if self.few else 4.5),
                zorder=7 if leads else 6,
            )

    def _heading(self, step: int) -> str:
        return f"{self.title}: {caption(self.trajectory, step)}"

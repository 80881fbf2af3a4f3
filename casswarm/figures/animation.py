"""A run that moves: the members on the map, and their formation close up."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from .base_map import GREYS, extent, frame, landmarks, pixels, single_agent_norm
from .closeups import (
    RELATIVE_RATE_NORM,
    Closeup,
    additional_agent_rates,
    follows,
    leader_at,
    shades,
    window,
)
from .formations import caption, legend_handles
from .style import BLUE, INK, MEMBERS, VERMILION, current_theme, scaled, settings, themed

_PIXELS = 110


def animate(
    scenario: Scenario,
    trace: RunTrajectory,
    guide: Guide | None = None,
    *,
    title: str = "",
    frames_per_second: float = 4.0,
) -> FuncAnimation:
    """A run as an animation, a frame a step: where the members are, who leads, and who is lost.

    On the left the map with the rate that one more member would have at every place, given where
    the others are then; on the right the formation close up, where the shades are that rate as a
    share of a lone member's. All scales are the same in every frame.

    Parameters
    ----------
    scenario : Scenario
    trace : Trace
        Such as ``study.trajectories["leader"][0]``.
    guide : Guide, optional
        Drawn on the map; where the swarm follows it, its point is the middle of the close-up.
    title : str
        The scenario's name by default.
    frames_per_second : float

    Returns
    -------
    matplotlib.animation.FuncAnimation
        In a notebook, ``HTML(casswarm.figures.player(animation))`` shows it; so does matplotlib's
        own ``to_jshtml``, which loads its signs from the network.

    Raises
    ------
    ValueError
        Not a positive number of frames per second.
    """
    if not frames_per_second > 0:
        raise ValueError(f"frames_per_second = {frames_per_second!r}; allowed: above 0")
    stage = Stage(scenario, trace, guide, title or scenario.name)
    interval = 1000.0 / frames_per_second
    return FuncAnimation(
        stage.figure,
        stage.show,
        frames=len(trace.alive),
        init_func=lambda: [],
        interval=interval,
        repeat_delay=4 * interval,
        cache_frame_data=False,
    )


class Stage:
    """A figure with a map and a close-up that can show any step of a run.

    Parameters
    ----------
    scenario : Scenario
    trace : Trace
    guide : Guide or None
    title : str
    """

    def __init__(
        self, scenario: Scenario, trace: RunTrajectory, guide: Guide | None, title: str
    ) -> None:
        self.scenario, self.trace, self.guide, self.title = scenario, trace, guide, title
        near = guide is not None and follows(trace, guide, scenario.formation.rho)
        self.middle = guide if near else None
        contents = [trace.positions.reshape(-1, 2)]
        self.low, self.high = extent(
            scenario, contents if guide is None else [*contents, guide.positions]
        )
        self.nodes = pixels(self.low, self.high, _PIXELS)
        self.settings = settings(current_theme())
        self.few = trace.alive.shape[1] <= len(MEMBERS)
        self.artists: list[Artist] = []
        self.figure = self._build()

    @themed
    def _build(self) -> Figure:
        size = self.high - self.low
        shape = size[1] / size[0]
        width = current_theme().width
        fig = Figure(figsize=(width, 0.62 * width), layout="constrained")
        FigureCanvasAgg(fig)
        self.map, close = fig.subplots(1, 2, width_ratios=(1.0, shape))
        frame(self.map, self.low, self.high)
        self._background(fig, close)
        handles = self._handles()
        columns = len(handles) if width > 5 else 3
        fig.legend(handles=handles, loc="outside lower center", ncols=columns)
        self.heading = fig.suptitle(self._words(0))
        return fig

    def _background(self, fig: Figure, close: Axes) -> None:
        """What stays: shades, landmarks, guide, scales."""
        norm = single_agent_norm(self.scenario, self.low, self.high)
        self.image = self.map.imshow(
            np.full(self.nodes.shape[:2], norm.vmin),
            norm=norm,
            cmap=GREYS,
            extent=(self.low[0], self.high[0], self.low[1], self.high[1]),
            origin="lower",
            interpolation="bilinear",
        )
        landmarks(self.map, self.scenario)
        if self.guide is not None:
            self.map.plot(*self.guide.positions.T, color=INK, lw=scaled(0.8), ls=":", zorder=3)
        half = window(self.trace, self.middle)
        self.closeup = Closeup(close, self.scenario, self.trace, self.middle, half, False)
        close.set_ylabel("")
        options: dict[str, Any] = {"location": "bottom", "pad": 0.02}
        fig.colorbar(
            self.image, ax=self.map, label="rate of one more member", extend="max", **options
        )
        share = ScalarMappable(RELATIVE_RATE_NORM, shades())
        label = "as a share of a lone member's"
        fig.colorbar(share, ax=close, label=label, extend="max", **options)

    def _handles(self) -> list[Artist]:
        """What the signs mean."""
        own, names = self.map.get_legend_handles_labels()
        leads = bool((self.trace.leaders >= 0).any())
        rest: list[Artist] = list(legend_handles(self.middle is not None, False, leads))
        if self.guide is not None:
            rest = [handle for handle in rest if handle.get_label() != "guide"]
            rest.append(Line2D([], [], color=INK, lw=scaled(0.8), ls=":", label="guide"))
        for handle in rest:
            if handle.get_label() == "lost in this step":
                handle.set_label("lost")
        return [*(handle for handle, name in zip(own, names, strict=True) if name), *rest]

    def show(self, step: int) -> list[Artist]:
        """Show a step."""
        with rc_context(self.settings):
            positions, alive = self.trace.positions[step], self.trace.alive[step]
            hazard = self.scenario.hazard
            self.image.set_data(additional_agent_rates(hazard, self.nodes, positions, alive))
            self.closeup.show(step)
            self.heading.set_text(self._words(step))
            for artist in self.artists:
                artist.remove()
            self.artists = []
            self._members(step)
        return self.artists

    def _members(self, step: int) -> None:
        """Members with their ways so far; the destroyed as crosses where they fell."""
        alive, leader = self.trace.alive[step], leader_at(self.trace, step)
        ends = np.minimum(step, self.trace.last_steps())
        for member, end in enumerate(ends):
            color = MEMBERS[member] if self.few else BLUE
            way = self.trace.positions[: end + 1, member]
            self.artists += self.map.plot(*way.T, color=color, lw=scaled(0.9), alpha=0.7, zorder=4)
            leads = member == leader
            self.artists += self.map.plot(
                *way[-1],
                marker="X" if not alive[member] else "*" if leads else "o",
                color="white"
                if not alive[member]
                else VERMILION
                if leads and not self.few
                else color,
                markeredgecolor=INK if leads or not alive[member] else "white",
                markeredgewidth=scaled(0.7),
                markersize=scaled(11 if leads else 6.5 if self.few else 4.5),
                zorder=7 if leads else 6,
            )

    def _words(self, step: int) -> str:
        return f"{self.title}: {caption(self.trace, step)}"

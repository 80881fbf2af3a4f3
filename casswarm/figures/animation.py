"""Animation of a run: the members on the map, and a close-up of their formation.

Animations become GIF files, or players for browsers and notebooks, without other programs.
"""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from .._util.documents import data_uri, render
from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from ..typing import Progress
from .base_map import draw_base_map, extent, pixels
from .closeups import (
    COLLISION,
    Closeup,
    additional_agent_rates,
    follows_guide,
    leader_at,
    window,
)
from .formations import caption, legend_handles
from .style import (
    BLUE,
    INK,
    MEMBERS,
    VERMILION,
    current_theme,
    marker,
    panels,
    scaled,
    settings,
    themed,
)

DPI = 110
_PIXELS = 110
_LAST = 6  # durations of a frame for which a GIF shows the last one


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


def save_gif(
    animation: FuncAnimation, path: Path | str, dpi: int = DPI, progress: Progress | None = None
) -> Path:
    """Write an animation as a GIF that repeats, with a pause at the last frame."""
    interval = _interval(animation)
    first, *others = _images(animation, dpi, progress)
    durations = [interval] * len(others) + [_LAST * interval]
    first.save(path, format="GIF", save_all=True, append_images=others, duration=durations, loop=0)
    return Path(path)


def player(
    animation: FuncAnimation,
    dpi: int = DPI,
    *,
    title: str = "Run of a swarm",
    page: bool = False,
    progress: Progress | None = None,
) -> str:
    """HTML that plays an animation, also step by step, with the mouse or the arrow keys.

    It is self-contained: nothing is loaded from the network.

    Parameters
    ----------
    animation : FuncAnimation
    dpi : int
    title : str
        Name for screen readers.
    page : bool
        Whether to return a whole page; otherwise it is an element of one, for
        ``IPython.display.HTML`` in a notebook.
    progress : Progress, optional
    """
    images = _images(animation, dpi, progress)
    width, height = images[0].size
    return render(
        "player.html",
        name=f"run-{uuid4().hex[:8]}",
        title=title,
        page=page,
        frames=[_png_uri(image) for image in images],
        interval=_interval(animation),
        width=width,
        height=height,
    )


def _interval(animation: FuncAnimation) -> int:
    """Milliseconds between frames."""
    source: Any = animation.event_source
    return int(source.interval)


def _png_uri(image: Image.Image) -> str:
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return data_uri(buffer.getvalue(), "image/png")


class _Frames(PillowWriter):
    """Writer that keeps the frames in memory."""

    _frames: list[Image.Image]

    def finish(self) -> None:
        """Write no file."""


@cache
def _palette() -> Image.Image:
    """Greys of the hazard rates, and the other colours of an animation with their soft edges."""
    colors = 255 * np.array([to_rgb(color) for color in (*MEMBERS, COLLISION)])
    tints = [
        weight * colors + (1 - weight) * background
        for background, weights in ((255, (1.0, 0.75, 0.5, 0.25)), (190, (0.7, 0.4)), (34, (0.5,)))
        for weight in weights
    ]
    # no grey just below white: Pillow finds the nearest colour on a coarse grid
    greys = np.append(np.linspace(20, 247, 255 - 7 * len(colors)), 255)
    palette = Image.new("P", (1, 1))
    rows = np.vstack([*tints, np.repeat(greys[:, None], 3, axis=1)])
    palette.putpalette(rows.round().astype(int).ravel().tolist())
    return palette


def _images(animation: FuncAnimation, dpi: int, progress: Progress | None) -> list[Image.Image]:
    """Frames in one palette, so that files are small and the background is still."""
    writer = _Frames()

    def report(frame: int, total: int | None) -> None:
        if progress is not None:
            progress("drawing frames", frame + 1, total)

    animation.save("not-written.gif", writer=writer, dpi=dpi, progress_callback=report)
    return [
        frame.convert("RGB").quantize(palette=_palette(), dither=Image.Dither.NONE)
        for frame in writer._frames
    ]


class RunFigure:
    """Figure with a map and a close-up that shows any step of a run."""

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
        self.image = draw_base_map(self.map, self.scenario, low, high)
        rho = self.scenario.formation.rho
        center = guide if guide and follows_guide(trajectory, guide, rho) else None
        half = window(trajectory, center)
        self.closeup = Closeup(close, self.scenario, trajectory, center, half)
        close.set_ylabel("")
        for image, label in (
            (self.image, "hazard rate of an additional agent"),
            (self.closeup.image, "relative to an isolated agent"),
        ):
            bar = fig.colorbar(image, ax=image.axes, extend="max", location="bottom", pad=0.02)
            bar.set_label(label)
        handles = [*self.map.get_legend_handles_labels()[0], *legend_handles(trajectory)]
        handles[-1].set_label("lost")
        if guide is not None:
            line = self.map.plot(*guide.positions.T, color=INK, lw=scaled(0.8), ls=":", zorder=3)
            line[0].set_label("guide")
            handles += line
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
            leads, size = member == leader, 6.5 if self.few else 4.5
            if leads:
                style = marker("*", 11, color if self.few else VERMILION, edge_width=0.7)
            elif alive[member]:
                style = marker("o", size, color, "white", 0.7)
            else:
                style = marker("X", size, edge_width=0.7)
            self.artists += self.map.plot(*path[-1], zorder=7 if leads else 6, **style)

    def _heading(self, step: int) -> str:
        return f"{self.title}: {caption(self.trajectory, step)}"

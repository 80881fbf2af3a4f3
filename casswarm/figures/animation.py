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
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.colors import to_rgb
from PIL import Image

from .._util.documents import data_uri, render
from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from ..typing import Progress
from .closeups import COLLISION
from .run_figure import RunFigure
from .style import MEMBERS

DPI = 110
_PER_STEP = 3  # frames at most
_SHORTEST = 40.0  # milliseconds of a frame
_LAST = 1500  # milliseconds for which a GIF shows the last one


class RunAnimation(FuncAnimation):
    """Animation of a run, with several frames of every step."""

    def __init__(self, *args: Any, frames_per_step: int, **options: Any) -> None:
        super().__init__(*args, **options)
        self.frames_per_step = frames_per_step

    def _repr_html_(self) -> str:
        """Player, which a notebook shows."""
        return player(self)


def animate(
    scenario: Scenario,
    trajectory: RunTrajectory,
    guide: Guide | None = None,
    *,
    title: str = "",
    steps_per_second: float = 4.0,
) -> FuncAnimation:
    """Animate a run: positions, leaders, losses, and mutual protection.

    On the left a map of the hazard rate of an additional agent, given the positions of the members
    at that time; on the right a close-up of the formation, with that rate relative to an isolated
    agent. All scales are the same in every frame. Between steps members move at constant velocity,
    in up to three frames per step.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
        For instance ``study.trajectories["leader"][0]``.
    guide : Guide, optional
        Drawn on the map; if the swarm follows it, the close-up is centred on it.
    title : str
        By default the scenario's name.
    steps_per_second : float

    Returns
    -------
    matplotlib.animation.FuncAnimation
        A notebook shows it in a `player`, where a cell ends with it.

    Raises
    ------
    ValueError
        `steps_per_second` is not positive.
    """
    if not steps_per_second > 0:
        raise ValueError(f"steps_per_second = {steps_per_second!r}; allowed: above 0")
    per_step = int(np.clip(1000.0 / (steps_per_second * _SHORTEST), 1, _PER_STEP))
    shown = RunFigure(scenario, trajectory, guide, title or scenario.name, per_step)
    interval = 1000.0 / (steps_per_second * per_step)
    return RunAnimation(
        shown.figure,
        shown.show,
        frames=len(shown.trajectory.alive),
        init_func=lambda: [],
        interval=interval,
        repeat_delay=_LAST,
        cache_frame_data=False,
        frames_per_step=per_step,
    )


def save_gif(
    animation: FuncAnimation, path: Path | str, dpi: int = DPI, progress: Progress | None = None
) -> Path:
    """Write an animation as a GIF that repeats, with a pause at the last frame."""
    interval = _interval(animation)
    first, *others = _images(animation, dpi, progress)
    durations = [interval] * len(others) + [_LAST]
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
        per_step=getattr(animation, "frames_per_step", 1),
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

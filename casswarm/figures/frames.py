"""Animations as GIF files, and as players for browsers and notebooks, without other programs."""

from __future__ import annotations

import base64
import io
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.colors import to_rgb
from PIL import Image

from ..typing import Progress
from .closeups import COLLISION
from .style import MEMBERS

DPI = 110
_LAST = 6  # durations of a frame for which a GIF shows the last one


class _Frames(PillowWriter):
    """Writer that keeps the frames in memory."""

    images: list[Image.Image]

    def finish(self) -> None:
        """Reduce the frames to one palette, so that files are small and the background is still."""
        frames: list[Image.Image] = self._frames  # type: ignore[attr-defined]
        self.images = [
            frame.convert("RGB").quantize(palette=_palette(), dither=Image.Dither.NONE)
            for frame in frames
        ]


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
    """Frames of an animation."""
    writer = _Frames()

    def report(frame: int, total: int | None) -> None:
        if progress is not None:
            progress("drawing frames", frame + 1, total)

    animation.save("not-written.gif", writer=writer, dpi=dpi, progress_callback=report)
    return writer.images


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
    from .._util.documents import render

    images = _images(animation, dpi, progress)
    width, height = images[0].size
    return render(
        "player.html",
        name=f"run-{uuid4().hex[:8]}",
        title=title,
        page=page,
        frames=[f"data:image/png;base64,{_png(image)}" for image in images],
        interval=_interval(animation),
        width=width,
        height=height,
    )


def _interval(animation: FuncAnimation) -> int:
    """Milliseconds between frames."""
    source: Any = animation.event_source
    return int(source.interval)


def _png(image: Image.Image) -> str:
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()

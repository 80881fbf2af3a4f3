"""Frames of an animation as a GIF, and as a player for browsers and notebooks; no other program."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import uuid4

from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.colors import to_rgb
from PIL import Image

from .closeups import OVER
from .style import BLUE, INK, MEMBERS, VERMILION

DPI = 110
_COLORS = 256  # of a GIF
_GREY = 0.75  # on which, as on white, signs have their blurred edges
_PAPER = 249  # from here on, grey is white: Pillow looks for the next colour on a coarse grid
_REST = 6  # frames for which the last one stays


class Frames(PillowWriter):
    """A writer that keeps the frames, all of them in the same colours."""

    def finish(self) -> None:
        """Nothing: the frames are asked for."""

    @cached_property
    def images(self) -> list[Image.Image]:
        """The frames with one palette, so that what stays the same does, and files are small."""
        frames: list[Image.Image] = self._frames  # type: ignore[attr-defined]
        some = frames[:: max(1, len(frames) // 6)]
        width, height = frames[0].size
        sheet = Image.new("RGB", (width, height * len(some)))
        for number, image in enumerate(some):
            sheet.paste(image, (0, number * height))
        palette = _palette(sheet)
        return [
            image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)
            for image in frames
        ]


def frames_of(
    animation: FuncAnimation, dpi: int = DPI, progress: Callable[[int, int], Any] | None = None
) -> list[Image.Image]:
    """The frames of an animation as images; `progress` is called with a frame's number and all."""
    writer = Frames()
    animation.save("unwritten.gif", writer=writer, dpi=dpi, progress_callback=progress)
    return writer.images


def save_gif(
    animation: FuncAnimation,
    path: Path | str,
    dpi: int = DPI,
    progress: Callable[[int, int], Any] | None = None,
) -> Path:
    """Write an animation as a GIF that repeats; the last frame stays for a while."""
    interval = int(_interval(animation))
    images = frames_of(animation, dpi, progress)
    durations = [interval] * (len(images) - 1) + [_REST * interval]
    images[0].save(
        path, format="GIF", save_all=True, append_images=images[1:], duration=durations, loop=0
    )
    return Path(path)


def player(
    animation: FuncAnimation,
    dpi: int = DPI,
    *,
    title: str = "A run",
    page: bool = False,
    progress: Callable[[int, int], Any] | None = None,
) -> str:
    """HTML that plays an animation: to start and stop, step by step, by mouse or arrow keys.

    It holds all that it needs and loads nothing.

    Parameters
    ----------
    animation : FuncAnimation
    dpi : int
    title : str
        What a screen reader calls it.
    page : bool
        Whether to return a whole page; otherwise it is a part of one, for
        ``IPython.display.HTML`` in a notebook.
    progress : callable, optional
        Called with a frame's number and their number.
    """
    from .._util.documents import render

    images = frames_of(animation, dpi, progress)
    width, height = images[0].size
    return render(
        "player.html",
        name=f"run-{uuid4().hex[:8]}",
        title=title,
        page=page,
        frames=[f"data:image/png;base64,{_png(image)}" for image in images],
        interval=int(_interval(animation)),
        width=width,
        height=height,
    )


def _interval(animation: FuncAnimation) -> float:
    """Milliseconds from frame to frame."""
    source: Any = animation.event_source
    return float(source.interval)


def _palette(sheet: Image.Image) -> Image.Image:
    """Colours of a sheet of frames; those of signs, which are small, among them in any case."""
    kept = [(255, 255, 255)] + [
        tuple(round(255 * (share * part + (1 - share) * ground)) for part in to_rgb(color))
        for color in dict.fromkeys((*MEMBERS, VERMILION, BLUE, OVER, INK))
        for ground, shares in ((1.0, (1.0, 0.75, 0.5, 0.25)), (_GREY, (0.7, 0.4)), (0.13, (0.5,)))
        for share in shares
    ]
    rest = sheet.quantize(_COLORS - len(kept), method=Image.Quantize.MEDIANCUT).getpalette() or []
    parts = [part for color in kept for part in color] + rest
    colors = [tuple(parts[k : k + 3]) for k in range(0, len(parts), 3)]
    paper = [(255, 255, 255) if min(color) >= _PAPER else color for color in colors]
    palette = Image.new("P", (1, 1))
    palette.putpalette([part for color in paper for part in color])
    return palette


def _png(image: Image.Image) -> str:
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()

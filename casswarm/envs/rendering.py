"""Pictures of a swarm on the map of its scenario."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import EnvError
from ..figures.base_map import add_start, base_map
from ..figures.style import BLUE, add_legend, add_title, marker, themed
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray

RENDER_MODES = ("rgb_array",)
RENDER_FPS = 5


def require_render_mode(mode: str | None) -> None:
    """Raise EnvError for an unknown render mode."""
    if mode is not None and mode not in RENDER_MODES:
        allowed = ", ".join(map(repr, RENDER_MODES))
        raise EnvError(f"render_mode = {mode!r}; allowed: None, {allowed}", render_mode=mode)


def frame(
    scenario: Scenario, step: int, positions: FloatArray, alive: BoolArray
) -> NDArray[np.uint8]:
    """Picture (height, width, 3) of the living members at a step, on the map of the hazard."""
    canvas = FigureCanvasAgg(_figure(scenario, step, positions, alive))
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    return pixels[..., :3].copy()


@themed
def _figure(scenario: Scenario, step: int, positions: FloatArray, alive: BoolArray) -> Figure:
    fig, axes = base_map(scenario, [scenario.positions])
    add_start(axes, scenario.positions)
    axes.plot(*positions[alive].T, zorder=6, label="living", **marker("o", 6, BLUE))
    add_legend(fig, axes)
    add_title(fig, scenario.name, f"step {step} of {scenario.n_steps}, {alive.sum()} alive")
    return fig

"""Labels of points; on a map, clear of its radars, its target, its paths and other labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from ..scenario import Scenario
from ..typing import FloatArray
from .style import current_theme, scaled

_OFFSET = 10.0  # points on a page from a point to the middle of its label
_MAP = 0.62  # about the width of a map, as a fraction of its figure's


class LabelPlaces:
    """Places that labels leave free on a map.

    Parameters
    ----------
    scenario : Scenario
    paths : sequence of (..., 2)
        Points that labels avoid, besides radars and target.
    width : float
        Of the map, in its own units.
    """

    def __init__(self, scenario: Scenario, paths: Sequence[FloatArray], width: float) -> None:
        self.distance = width * scaled(_OFFSET) / (72 * _MAP * current_theme().width)
        radars = scenario.hazard.radar_positions.reshape(-1, 2)
        points = np.vstack([path.reshape(-1, 2) for path in paths])
        self.centers = np.vstack([points, radars, np.asarray(scenario.target.center)[None]])
        self.radii = np.zeros(len(self.centers))
        self.radii[len(points) :] = 0.8 * self.distance
        self.radii[-1] += scenario.target.radius

    def add(self, axes: Axes, text: str, point: FloatArray) -> None:
        """Write a label beside a point (2,)."""
        direction = self.clearest_direction(point)
        self.centers = np.vstack([self.centers, point + self.distance * direction])
        self.radii = np.append(self.radii, 0.8 * self.distance)
        offset = (_OFFSET * float(direction[0]), _OFFSET * float(direction[1]))
        add_label(axes, text, point, offset, outlined=True, ha="center", va="center", zorder=7)

    def clearest_direction(self, point: FloatArray) -> FloatArray:
        """Direction (2,) from a point in which a label is farthest from what it avoids."""
        angles = np.pi / 4 * np.array([7, 5, 1, 3, 6, 2, 0, 4])  # of equals the first is taken
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        offsets = (point + self.distance * directions)[:, None] - self.centers
        gaps = (np.linalg.norm(offsets, axis=2) - self.radii).min(axis=1)
        return np.asarray(directions[int(np.argmax(gaps.round(9)))])


def add_label(
    axes: Axes,
    text: str,
    point: Any,
    offset: tuple[float, float],
    outlined: bool = False,
    **options: Any,
) -> Annotation:
    """Write small text at an offset, in points on a page, from a point.

    An outline makes it readable on any background. `options` are those of ``Axes.annotate``.
    """
    if outlined:
        outline = withStroke(linewidth=scaled(1.8), foreground="white", alpha=0.85)
        options["path_effects"] = [outline]
    place = (scaled(offset[0]), scaled(offset[1]))
    return axes.annotate(
        text, point, place, textcoords="offset points", fontsize="small", **options
    )

"""The map below the points: rates of a single agent as shades."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..planning.guide import Guide
from ..typing import FloatArray

if TYPE_CHECKING:
    from ..scenario import Scenario

SIZE = 96  # pixels along each side
_MARGIN = 0.15  # of the frame, relative to the larger side of what it holds
_BEYOND = 1.5  # ratio of the sides of the map and its frame, which a page may keep when it changes
_CAP = 0.995  # quantile of the rates at which the scale ends: near radars they are far higher
_DECADES = 1e3  # ratio of the ends of the scale


@dataclass(frozen=True, eq=False)
class HazardMap:
    """Rates of a single agent at the pixels of a square map, on a logarithmic scale.

    Parameters
    ----------
    low, high : (2,)
        Corners of the map.
    frame : (2, 2)
        Corners of the square within it that holds all points.
    shades : (SIZE, SIZE) uint8
        Row by row from the bottom; 255 for the highest rates.
    """

    low: FloatArray
    high: FloatArray
    frame: FloatArray
    shades: NDArray[np.uint8]

    @classmethod
    def around(cls, scenario: Scenario, guide: Guide) -> HazardMap:
        """Map that holds the members, the target, the radars and the guide."""
        center, radius = np.asarray(scenario.target.center), scenario.target.radius
        zone = center + radius * np.array([[-1, -1], [1, 1]])
        radars = scenario.hazard.radar_positions
        points = np.vstack([scenario.positions, zone, radars, guide.positions])
        low, high = points.min(axis=0), points.max(axis=0)
        half = (0.5 + _MARGIN) * float((high - low).max())
        middle = 0.5 * (low + high)
        frame = np.stack([middle - half, middle + half])
        low, high = middle - _BEYOND * half, middle + _BEYOND * half
        axis = (np.arange(SIZE) + 0.5) / SIZE * 2 * _BEYOND * half
        pixels = np.stack(np.meshgrid(low[0] + axis, low[1] + axis), axis=-1)
        return cls(low, high, frame, _shades(scenario.hazard.single_agent_rates(pixels)))


def _shades(rates: FloatArray) -> NDArray[np.uint8]:
    top = float(np.quantile(rates, _CAP))
    floor = max(float(rates.min()), top / _DECADES)
    if not 0 < floor < top:
        return np.zeros(rates.shape, np.uint8)
    scale = np.log(np.clip(rates, floor, top) / floor) / np.log(top / floor)
    return np.asarray(np.rint(255 * scale), np.uint8)

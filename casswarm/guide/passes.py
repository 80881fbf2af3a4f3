"""Radars that a path passes within a step, in which rates are not evaluated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..hazard import subdivided
from ..scenario import Scenario
from ..typing import FloatArray

_COARSE = 0.5  # length of a part of a step, relative to the distance to a radar, that is too long


class Pass(NamedTuple):
    """A part of a step that passes a radar.

    Parameters
    ----------
    step : int
        t, of the step from X(t) to X(t+1).
    radar : int
    length : float
        Length of the part.
    distance : float
        Least distance to the radar on the way.
    """

    step: int
    radar: int
    length: float
    distance: float


def coarsest_pass(scenario: Scenario, positions: FloatArray) -> Pass | None:
    """The part of a path (T+1, 2) that is longest relative to its distance to a radar it passes.

    None if no part is longer than half of that distance. A radar is passed where the nearest point
    to it is neither end of the part.
    """
    parts, hazard = scenario.time.substeps, scenario.by_parts.hazard
    path = subdivided(positions, parts)
    moves = np.diff(path, axis=0)
    lengths = np.hypot(*moves.T)
    radars = [hazard.after(k + 1).radar_positions.reshape(-1, 2) for k in range(len(moves))]
    offsets = np.array(radars) - path[:-1, None]  # (K, k, 2)
    with np.errstate(divide="ignore", invalid="ignore"):  # parts without length, no distance
        shares = (offsets * moves[:, None]).sum(axis=-1) / lengths[:, None] ** 2
        distances = np.hypot(*np.moveaxis(offsets - shares[..., None] * moves[:, None], -1, 0))
        ratios = np.where((shares > 0) & (shares < 1), lengths[:, None] / distances, 0.0)
    if not ratios.size or not ratios.max() > _COARSE:
        return None
    k, radar = np.unravel_index(int(ratios.argmax()), ratios.shape)
    return Pass(int(k) // parts, int(radar), float(lengths[k]), float(distances[k, radar]))

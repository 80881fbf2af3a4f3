"""Changing parameters of a scenario, two of which are no keys of it: n and spacing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ScenarioError
from ..typing import FloatArray

if TYPE_CHECKING:
    from . import Scenario


def with_parameters(scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Copy of the scenario with other values, among them those of `SPECIAL`.

    Raises
    ------
    ScenarioError
        Values that are wrong.
    """
    plain = {key: value for key, value in values.items() if key not in SPECIAL}
    changed = scenario.with_values(plain) if plain else scenario
    for key in SPECIAL:
        if key in values:
            places = SPECIAL[key](changed.positions, values[key])
            changed = changed.with_values({"swarm.positions": places.tolist()})
    return changed


def _with_members(positions: FloatArray, n: Any) -> FloatArray:
    if not (isinstance(n, int) and n >= 1):
        raise ScenarioError(f"n = {n!r}; allowed: whole numbers from 1")
    if n <= len(positions):
        return positions[:n]
    distance = (_nearest(positions) if len(positions) > 1 else 0.0) or 0.5
    reach = math.ceil(math.sqrt(n)) + 2
    steps = np.arange(-2 * reach, 2 * reach + 1)
    east, north = (part.ravel() for part in np.meshgrid(steps, steps))
    lattice = distance * np.stack([east + 0.5 * north, 0.75**0.5 * north], axis=1)
    lattice = lattice[np.lexsort((lattice[:, 1], lattice[:, 0], np.hypot(*lattice.T).round(9)))]
    places = list(positions)
    for place in lattice + positions.mean(axis=0):
        if len(places) == n:
            break
        if np.hypot(*(np.array(places) - place).T).min() > 0.5 * distance:
            places.append(place)
    return np.array(places)


def _with_spacing(positions: FloatArray, spacing: Any) -> FloatArray:
    if not (isinstance(spacing, (int, float)) and 0 < spacing < math.inf):
        raise ScenarioError(f"spacing = {spacing!r}; allowed: finite numbers above 0")
    if len(positions) < 2 or _nearest(positions) == 0:
        raise ScenarioError("spacing needs two members at different places")
    center = positions.mean(axis=0)
    return np.asarray(center + (positions - center) * (spacing / _nearest(positions)))


def _nearest(positions: FloatArray) -> float:
    """Distance of the nearest two."""
    apart = np.hypot(*(positions[:, None] - positions[None]).transpose(2, 0, 1))
    return float(apart[~np.eye(len(positions), dtype=bool)].min())


SPECIAL: dict[str, Callable[[FloatArray, Any], FloatArray]] = {
    "n": _with_members,
    "spacing": _with_spacing,
}
"""Parameters that are no keys of a scenario."""

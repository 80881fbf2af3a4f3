"""The way on from everywhere: what a value function says over a part of the plane, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...typing import FloatArray
from .value_function import ValueFunction

_NODES = 150  # an axis
_ARROWS = slice(4, None, 9)  # of the nodes, an axis


@dataclass(frozen=True, eq=False)
class CostToGoMap:
    """Survival and next velocities of a lone member from places between two corners, at a step.

    Parameters
    ----------
    step : int
    low, high : (2,)
        The corners.
    survival : (m, m)
        exp(-upper bound of the risk to go), row by row from below; 0 where no way is known.
    places, velocities : (k, 2)
        Some of the places, and the best next velocity at each.
    """

    step: int
    low: FloatArray
    high: FloatArray
    survival: FloatArray
    places: FloatArray
    velocities: FloatArray

    @classmethod
    def of(
        cls, value: ValueFunction, low: FloatArray, high: FloatArray, step: int = 0
    ) -> CostToGoMap:
        """What a value function says between the corners `low` and `high`."""
        east, north = (np.linspace(low[axis], high[axis], _NODES) for axis in (0, 1))
        nodes = np.stack(np.meshgrid(east, north), axis=-1)
        places = nodes[_ARROWS, _ARROWS].reshape(-1, 2)
        survival = np.exp(-value.bounds(step, nodes)[1])
        return cls(step, low, high, survival, places, value.velocities(step, places))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it as arrays by name, to be kept."""
        return {part.name: np.asarray(getattr(self, part.name)) for part in fields(self)}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> CostToGoMap:
        """The outlook of `arrays`, again."""
        found: dict[str, Any] = {part.name: arrays[part.name] for part in fields(cls)}
        found["step"] = int(found["step"])
        return cls(**found)

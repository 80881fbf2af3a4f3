"""Potentials of a batch of states from a table of risks to go."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from .._util.jit import kernel
from ..typing import BoolArray, FloatArray, IntArray


class RiskTable(NamedTuple):
    """Lower bounds of the risk to go, bilinear between the nodes of a grid, constant outwards.

    Parameters
    ----------
    values : (N+1, nx, ny)
        At every step.
    east, north : float
        Of the first node.
    spacing : float
    slack : float
        Bound on the rounding of values.
    """

    values: Any
    east: float
    north: float
    spacing: float
    slack: float


@kernel
def cell(coordinate: float, nodes: int) -> tuple[int, float]:
    """First node and fraction of the cell of a coordinate in spacings from the first node."""
    inside = min(max(coordinate, 0.0), nodes - 1.0)
    first = min(int(inside), nodes - 2)
    return first, inside - first


@kernel
def risk_to_go(table: RiskTable, step: int, east: float, north: float) -> float:
    """Lower bound of the risk to go from a place at a step."""
    values = table.values[step]
    i, u = cell((east - table.east) / table.spacing, values.shape[0])
    j, v = cell((north - table.north) / table.spacing, values.shape[1])
    left = (1.0 - v) * values[i, j] + v * values[i, j + 1]
    right = (1.0 - v) * values[i + 1, j] + v * values[i + 1, j + 1]
    return max(0.0, (1.0 - u) * left + u * right - table.slack)  # type: ignore[no-any-return]


@kernel
def write_potentials(
    table: RiskTable,
    steps: IntArray,
    positions: FloatArray,
    alive: BoolArray,
    ended: BoolArray,
    potentials: FloatArray,
) -> None:
    """Write the potentials (B,) of B states, see `casswarm.envs.shaping`; 0 where a run ended."""
    for b in range(ended.size):
        failure = 1.0
        if not ended[b]:
            for i in range(alive.shape[1]):
                if alive[b, i]:
                    at = positions[b, i]
                    failure *= -math.expm1(-risk_to_go(table, steps[b], at[0], at[1]))
        potentials[b] = 1.0 - failure

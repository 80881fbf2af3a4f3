"""Lower bounds of inverse squared distances, for certificates.

With K = 1 / R^2 the capped rate min(1 / r^2, K) is nowhere above 1 / r^2, nor, for R >=
`CORE_RADIUS`, above its regularised version (see `casswarm.hazard.kernels.regular`). Interpolated
bilinearly between the corners of a cell of side h, a function f is at most

    e = h^2 / 8 (max f_xx^+ + max f_yy^+)

above itself, each maximum over the cell. For f = 1 / r^2 the second derivatives are f_xx = (6 x^2 -
2 y^2) / r^6 and f_yy = (6 y^2 - 2 x^2) / r^6, at most (6 x_far^2 - 2 y_near^2)^+ / r_near^6 and
likewise over a square. A cap only lowers interpolated values, and where the whole cell is capped
there is nothing to correct. Hence the values

    min(1 / r^2, K) - e

at nodes, with e for the square of side 2 h around the node, which holds its four cells: their
bilinear interpolation is nowhere above 1 / r^2. R = 8 h keeps them positive.
"""

from __future__ import annotations

import numpy as np

from .._util.constants import CORE_RADIUS
from ..typing import FloatArray

CAP = 8.0
"""R in spacings."""


def cap_radius(spacing: float) -> float:
    """R, the distance to a radar below which the rate counts as if at R."""
    return max(CAP * spacing, CORE_RADIUS)


def inverse_squares_below(
    east: FloatArray, north: FloatArray, spacing: float, radars: FloatArray, strengths: FloatArray
) -> FloatArray:
    """Sum over radars of strength times the node values above, shape (n, m).

    Parameters
    ----------
    east, north : (n,), (m,)
        Coordinates of the nodes.
    spacing : float
        h, the side of a cell.
    radars, strengths : (k, 2), (k,)
    """
    squared_cap = cap_radius(spacing) ** 2
    total = np.zeros((len(east), len(north)))
    for radar, strength in zip(radars, strengths, strict=True):
        away = [np.abs(nodes - place) for nodes, place in zip((east, north), radar, strict=True)]
        at, near, far = (
            [column[:, None] ** 2, row**2]
            for column, row in (
                away,
                [np.maximum(a - spacing, 0.0) for a in away],
                [a + spacing for a in away],
            )
        )
        value = np.maximum(at[0] + at[1], squared_cap)
        np.divide(strength, value, out=value)
        total += value
        curved = np.maximum(6 * far[0] - 2 * near[1], 0.0)
        curved += np.maximum(6 * far[1] - 2 * near[0], 0.0)
        nearest = near[0] + near[1]
        nearest[far[0] + far[1] <= squared_cap] = np.inf
        curved *= strength * spacing**2 / 8
        total -= np.divide(curved, nearest**3, out=curved)
    return total


def least_inverse_squares(
    lower: FloatArray, upper: FloatArray, radars: FloatArray, strengths: FloatArray
) -> FloatArray:
    """Sum over radars of strength times the least 1 / r^2 in a box, (..., 2), (..., 2) to (...)."""
    total = np.zeros(np.broadcast_shapes(lower.shape, upper.shape)[:-1])
    for radar, strength in zip(radars, strengths, strict=True):
        farthest = np.maximum(np.abs(lower - radar), np.abs(upper - radar))
        squared = (farthest**2).sum(axis=-1)
        total += strength / np.maximum(squared, CORE_RADIUS**2)
    return total

"""The formation problem's objective and its gradient for several states at a time, in lanes.

The sums of `casswarm.formation.objective_kernels`, for few members. A row has a number of every
lane; operations on rows are vector instructions, which is why they have no branches. The rows of a
member are together, `ROWS` of them, at distances that the compiler knows: it then sees that they do
not overlap.
"""

from __future__ import annotations

from ..compiled.kernels import kernel
from ..hazard.rate_kernels import (
    COLLIDES,
    DIFFER,
    FIRST_RADAR,
    HAS_ZONES,
    collision,
    combine,
    density,
    source,
    unpacked,
    zone,
)
from ..typing import FloatArray

LANES = 16
"""Numbers of a row. Those of a lane do not depend on the others."""

EAST, NORTH, ALIVE, WEIGHT, BY_DENSITY, BY_COLLISION, RISK, GRADIENT_EAST, GRADIENT_NORTH = range(
    0, 9 * LANES, LANES
)
"""Where the rows of a member begin: position, 1 or 0, weight, sums, and the gradient."""

ROWS = 9
"""Rows of a member."""


@kernel
def density_of(i: int, members: FloatArray, constants: FloatArray) -> float:
    """Factor of what a member adds to the densities of others."""
    return constants[constants.size - members.size // (ROWS * LANES) + i] if DIFFER else 1.0


@kernel
def evaluate_lanes(
    members: FloatArray,
    active: FloatArray,
    constants: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> float:
    """Write the objective of positions to `values`, and its gradient to the rows of members.

    `active` has as many entries as there are lanes in use, the first ones.
    """
    lanes, n = active.size, members.size // (ROWS * LANES)
    parameters = unpacked(constants)
    last = constants.size - 2 * n if DIFFER else constants.size
    own_density = density(0.0, parameters)[0]
    for k in range(lanes):
        values[k] = 0.0
    for i in range(n):
        own, share = members[i * ROWS * LANES :], density_of(i, members, constants)
        for k in range(lanes):
            own[BY_DENSITY + k] = share * own_density
            own[BY_COLLISION + k] = 0.0
    for i in range(n):
        for j in range(i):
            add_pair(i, j, members, lanes, constants, scratch)
    for i in range(n):
        own = members[i * ROWS * LANES :]
        rate_lanes(own, lanes, constants, last, constants[last + i] if DIFFER else 1.0, values)
    for i in range(n):
        for j in range(i):
            add_pair_gradient(i, j, members, lanes, constants, scratch)
    return 0.0


@kernel
def add_pair(
    i: int,
    j: int,
    members: FloatArray,
    lanes: int,
    constants: FloatArray,
    scratch: FloatArray,
) -> None:
    """Add the density and collision rate of a pair to its members' sums, and keep the slopes."""
    own, other = members[i * ROWS * LANES :], members[j * ROWS * LANES :]
    parameters, slopes = unpacked(constants), scratch[(i * (i - 1) + 2 * j) * LANES :]
    share, share_other = density_of(i, members, constants), density_of(j, members, constants)
    for k in range(lanes):
        de, dn = own[EAST + k] - other[EAST + k], own[NORTH + k] - other[NORTH + k]
        value, slope = density(de * de + dn * dn, parameters)
        both = own[ALIVE + k] * other[ALIVE + k] > 0.0
        value, slopes[k] = value if both else 0.0, slope if both else 0.0
        own[BY_DENSITY + k] += share_other * value
        other[BY_DENSITY + k] += share * value
    if COLLIDES:
        for k in range(lanes):
            de, dn = own[EAST + k] - other[EAST + k], own[NORTH + k] - other[NORTH + k]
            value, slope = collision(de * de + dn * dn, parameters)
            both = own[ALIVE + k] * other[ALIVE + k] > 0.0
            value, slopes[LANES + k] = value if both else 0.0, slope if both else 0.0
            own[BY_COLLISION + k] += value
            other[BY_COLLISION + k] += value


@kernel
def add_pair_gradient(
    i: int,
    j: int,
    members: FloatArray,
    lanes: int,
    constants: FloatArray,
    scratch: FloatArray,
) -> None:
    """Add the gradient of a pair, with the derivatives in the sums in their place."""
    own, other = members[i * ROWS * LANES :], members[j * ROWS * LANES :]
    slopes = scratch[(i * (i - 1) + 2 * j) * LANES :]
    share, share_other = density_of(i, members, constants), density_of(j, members, constants)
    for k in range(lanes):
        slope = slopes[k] * (share_other * own[BY_DENSITY + k] + share * other[BY_DENSITY + k])
        if COLLIDES:
            slope += slopes[LANES + k] * (own[BY_COLLISION + k] + other[BY_COLLISION + k])
        slopes[k] = slope
    for k in range(lanes):
        own[GRADIENT_EAST + k] += slopes[k] * (own[EAST + k] - other[EAST + k])
        own[GRADIENT_NORTH + k] += slopes[k] * (own[NORTH + k] - other[NORTH + k])
    for k in range(lanes):
        other[GRADIENT_EAST + k] -= slopes[k] * (own[EAST + k] - other[EAST + k])
        other[GRADIENT_NORTH + k] -= slopes[k] * (own[NORTH + k] - other[NORTH + k])


@kernel
def rate_lanes(
    own: FloatArray,
    lanes: int,
    constants: FloatArray,
    last: int,
    exposure: float,
    values: FloatArray,
) -> None:
    """Add a member's weighted rate to the values; write its derivatives in place of the sums."""
    parameters = unpacked(constants)
    for k in range(lanes):
        own[RISK + k], own[GRADIENT_EAST + k], own[GRADIENT_NORTH + k] = 0.0, 0.0, 0.0
    if HAS_ZONES:
        for k in range(lanes):
            risk, east, north = zone(own[EAST + k], own[NORTH + k], parameters)
            own[RISK + k], own[GRADIENT_EAST + k], own[GRADIENT_NORTH + k] = (
                risk,
                0.5 * east,
                0.5 * north,
            )
    for r in range(FIRST_RADAR, last, 3):
        east, north, strength = constants[r], constants[r + 1], constants[r + 2]
        for k in range(lanes):
            de, dn = own[EAST + k] - east, own[NORTH + k] - north
            value, slope = source(de * de + dn * dn, parameters)
            own[RISK + k] += strength * value
            own[GRADIENT_EAST + k] += strength * slope * de
            own[GRADIENT_NORTH + k] += strength * slope * dn
    for k in range(lanes):
        rate, by_risk, by_density, by_collision = combine(
            exposure * own[RISK + k], own[BY_DENSITY + k], own[BY_COLLISION + k], parameters
        )
        weight = own[WEIGHT + k]
        values[k] += weight * rate if weight != 0.0 else 0.0
        factor = 2.0 * weight
        own[BY_DENSITY + k] = factor * by_density
        own[BY_COLLISION + k] = factor * by_collision
        own[GRADIENT_EAST + k] *= factor * exposure * by_risk
        own[GRADIENT_NORTH + k] *= factor * exposure * by_risk


LANE_KERNELS = density_of, add_pair, add_pair_gradient, rate_lanes, evaluate_lanes
"""Kernels that the objective is made of, for `casswarm.hazard.rate_module`."""

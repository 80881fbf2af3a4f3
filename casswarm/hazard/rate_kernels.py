"""Rates of a hazard's members as compiled code: of a member, and of all in a batch of states.

The functions at the beginning stand for the kernels of a hazard. `compiled_rates.rate_module` makes
them from its expressions, and compiles what calls them with these in their place, so that they are
inlined. The constants of a hazard are its parameters, and the position and strength of every radar.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from ..compiled.kernels import kernel, stand_in
from ..typing import BoolArray, FloatArray

Parameters: TypeAlias = tuple[float, ...]
Two: TypeAlias = tuple[float, float]

LANES = 32
"""Positions of the swarm in a block, for which an operation is done before the next one."""

COLLIDES = HAS_ZONES = DIFFER = True
"""Stand for whether members collide, whether there are zones, and whether members differ."""

FIRST_RADAR = 2
"""Stands for the place of the first radar in the constants, after the parameters.

The exposures and densities of n members that differ follow the last radar."""


unpacked = stand_in
"""Parameters of the hazard, from its constants."""

source = density = collision = stand_in
"""Kernels of a radar, of another member and of collisions, each followed by its derivative.

Functions of the squared distance and the parameters.
"""

zone = stand_in
"""Sum over the zones at a position, (east, north, parameters), and its gradient."""

combine = stand_in
"""Rate from its three sums and the parameters, and its gradient in the sums."""

second_source = second_density = second_collision = second_combine = second_zone = stand_in
"""The same with second derivatives; those of the rate are the upper triangle by rows."""


@kernel
def member_rate(
    i: int,
    n: int,
    position: Two,
    sums: Two,
    factor: float,
    constants: FloatArray,
    parameters: Parameters,
) -> tuple[float, float, float, float, float]:
    """Rate of member i of n, and times a factor its derivatives.

    Those are half the gradient of the sum over radars and zones, and the derivatives in the two
    other `sums`.
    """
    risk, risk_east, risk_north = zone(position[0], position[1], parameters)
    risk_east, risk_north = 0.5 * risk_east, 0.5 * risk_north
    last = constants.size - 2 * n if DIFFER else constants.size
    for r in range(FIRST_RADAR, last, 3):
        de, dn = position[0] - constants[r], position[1] - constants[r + 1]
        value, slope = source(de * de + dn * dn, parameters)
        risk += constants[r + 2] * value
        risk_east += constants[r + 2] * slope * de
        risk_north += constants[r + 2] * slope * dn
    if DIFFER:
        exposure = constants[last + i]
        risk, risk_east, risk_north = exposure * risk, exposure * risk_east, exposure * risk_north
    rate, by_risk, by_density, by_collision = combine(risk, sums[0], sums[1], parameters)
    return (
        rate,
        factor * by_risk * risk_east,
        factor * by_risk * risk_north,
        factor * by_density,
        factor * by_collision,
    )


@kernel
def write_block(
    x: FloatArray, alive: FloatArray, constants: FloatArray, lanes: int, sums: FloatArray
) -> None:
    """Write the rates of so many states to ``sums[0]``, lane by lane; `sums` (3, n lanes)."""
    parameters = unpacked(constants)
    values, densities, collisions = sums[0], sums[1], sums[2]
    n = values.size // lanes
    last = constants.size - 2 * n if DIFFER else constants.size
    own_density = density(0.0, parameters)[0]
    for k in range(n * lanes):
        densities[k], collisions[k], values[k] = own_density, 0.0, 0.0
        if DIFFER:
            densities[k] *= constants[last + n + k // lanes]
    for i in range(n):
        own = slice(i * lanes, (i + 1) * lanes)
        living, values_i = alive[own], values[own]
        densities_i, collisions_i = densities[own], collisions[own]
        east = x[2 * i * lanes : (2 * i + 1) * lanes]
        north = x[(2 * i + 1) * lanes : (2 * i + 2) * lanes]
        for j in range(i + 1, n):
            other = slice(j * lanes, (j + 1) * lanes)
            living_j, densities_j, collisions_j = alive[other], densities[other], collisions[other]
            east_j = x[2 * j * lanes : (2 * j + 1) * lanes]
            north_j = x[(2 * j + 1) * lanes : (2 * j + 2) * lanes]
            for k in range(lanes):
                de, dn = east[k] - east_j[k], north[k] - north_j[k]
                value = density(de * de + dn * dn, parameters)[0]
                if DIFFER:
                    densities_i[k] += constants[last + n + j] * living_j[k] * value
                    densities_j[k] += constants[last + n + i] * living[k] * value
                else:
                    densities_i[k] += living_j[k] * value
                    densities_j[k] += living[k] * value
            if COLLIDES:
                for k in range(lanes):
                    de, dn = east[k] - east_j[k], north[k] - north_j[k]
                    value = collision(de * de + dn * dn, parameters)[0]
                    collisions_i[k] += living_j[k] * value
                    collisions_j[k] += living[k] * value
        for r in range(FIRST_RADAR, last, 3):
            radar_east, radar_north, strength = constants[r], constants[r + 1], constants[r + 2]
            for k in range(lanes):
                de, dn = east[k] - radar_east, north[k] - radar_north
                values_i[k] += strength * source(de * de + dn * dn, parameters)[0]
        if HAS_ZONES:
            for k in range(lanes):
                values_i[k] += zone(east[k], north[k], parameters)[0]
        if DIFFER:
            for k in range(lanes):
                values_i[k] *= constants[last + i]
    for k in range(n * lanes):
        values[k] = combine(values[k], densities[k], collisions[k], parameters)[0]


@kernel
def write_rates(
    alive: BoolArray,
    positions: FloatArray,
    constants: FloatArray,
    rates: FloatArray,
    work: FloatArray,
) -> bool:
    """Write the rates of B states in blocks of as many as `work` (6, n lanes) holds.

    Returns whether all of them are finite and not negative.
    """
    batch, n = alive.shape
    lanes, valid = work.shape[1] // n, True
    x, living, values = work[:2].reshape(-1), work[2], work[3]
    for first in range(0, batch, lanes):
        count = min(lanes, batch - first)
        for k in range(lanes):
            b = first + min(k, count - 1)  # the last block is filled
            for i in range(n):
                x[2 * i * lanes + k] = positions[b, i, 0]
                x[(2 * i + 1) * lanes + k] = positions[b, i, 1]
                living[i * lanes + k] = 1.0 if alive[b, i] else 0.0
        write_block(x, living, constants, lanes, work[3:])
        for k in range(count):
            for i in range(n):
                rate = values[i * lanes + k] if alive[first + k, i] else 0.0
                valid = valid and 0.0 <= rate < math.inf
                rates[first + k, i] = rate
    return valid

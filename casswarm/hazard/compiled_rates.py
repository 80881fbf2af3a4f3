"""Rates of all members of a state as a compiled function, for hazards that are made of kernels.

The sums of `casswarm.hazard.kernel_hazard`, in which every pair of members is evaluated once. The
results differ from those of `Hazard.rates` by rounding only. Several states are evaluated together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compiled.kernels import generated_module
from ..errors import HazardError
from ..typing import BoolArray, FloatArray
from .base import Hazard
from .kernel_hazard import KernelHazard, differentiated_kernels

_RATES = """
@kernel
def write_blocks(x, alive, constants, lanes, values, densities, collisions):
    n, radars = int(constants[0]), int(constants[1])
    parameters = {parameters}
    own_density = density(0.0, parameters)[0]
    for k in range(n * lanes):
        densities[k], collisions[k], values[k] = own_density, 0.0, 0.0
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
                densities_i[k] += living_j[k] * value
                densities_j[k] += living[k] * value
            if {collides}:
                for k in range(lanes):
                    de, dn = east[k] - east_j[k], north[k] - north_j[k]
                    value = collision(de * de + dn * dn, parameters)[0]
                    collisions_i[k] += living_j[k] * value
                    collisions_j[k] += living[k] * value
        for r in range(2, 2 + 3 * radars, 3):
            radar_east, radar_north, strength = constants[r], constants[r + 1], constants[r + 2]
            for k in range(lanes):
                de, dn = east[k] - radar_east, north[k] - radar_north
                values_i[k] += strength * source(de * de + dn * dn, parameters)[0]
    for k in range(n * lanes):
        values[k] = combine(values[k], densities[k], collisions[k], parameters)[0]


@kernel
def write_rates(alive, positions, constants, rates, work):
    batch, n = alive.shape
    lanes, valid = work.size // (6 * n), True
    size = n * lanes
    x, living, values = work[: 2 * size], work[2 * size : 3 * size], work[3 * size : 4 * size]
    densities, collisions = work[4 * size : 5 * size], work[5 * size :]
    for first in range(0, batch, lanes):
        count = min(lanes, batch - first)
        for k in range(lanes):
            b = first + min(k, count - 1)  # the last block is filled
            for i in range(n):
                x[2 * i * lanes + k] = positions[b, i, 0]
                x[(2 * i + 1) * lanes + k] = positions[b, i, 1]
                living[i * lanes + k] = 1.0 if alive[b, i] else 0.0
        write_blocks(x, living, constants, lanes, values, densities, collisions)
        for k in range(count):
            for i in range(n):
                rate = values[i * lanes + k] if alive[first + k, i] else 0.0
                valid = valid and 0.0 <= rate < math.inf
                rates[first + k, i] = rate
    return valid
"""
"""Rates of B states, in blocks of as many as `work` holds, so that their loops are vectorised.

Text, because the kernels that it calls are generated: compiled in one module with them, they are
inlined.
"""

_LANES = 64  # states of a block: they fit in the first cache


@dataclass(frozen=True, eq=False)
class CompiledRates:
    """Rates of n members as a compiled function.

    Parameters
    ----------
    n : int
    source : str
        Text of the compiled function, which all hazards of a class share.
    constants : (s,)
        n, the number of radars, their positions and strengths, and parameters of the hazard.
    """

    n: int
    source: str
    constants: FloatArray

    def __call__(self, positions: FloatArray, alive: BoolArray, rates: FloatArray) -> bool:
        """Write the rates (B, n) of states (B, n, 2), (B, n), 0 for the destroyed.

        Returns whether all of them are finite and not negative.
        """
        work = np.empty(6 * self.n * min(len(alive), _LANES))
        compiled = generated_module(self.source).write_rates
        return bool(compiled(alive, positions, self.constants, rates, work))


def compiled_rates(hazard: Hazard, n: int) -> CompiledRates | None:
    """The compiled rates of n members.

    None for hazards that are not made of kernels, or of such as have no counterpart in Python.
    """
    if not isinstance(hazard, KernelHazard):
        return None
    try:
        source, parameters = differentiated_kernels(hazard)
    except HazardError:
        return None
    radars = np.column_stack([hazard.radar_positions, hazard.radar_strengths])
    constants = np.concatenate([[n, len(radars)], radars.ravel(), parameters])
    names = [f"constants[2 + 3 * radars + {i}]," for i in range(len(parameters))]
    rates = _RATES.format(collides=hazard.collides, parameters=f"({' '.join(names)})")
    return CompiledRates(n, f"{source}\n{rates}", constants)

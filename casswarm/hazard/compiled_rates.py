"""Rates of all members of a state as a compiled function, for hazards that are made of kernels.

The sums of `casswarm.hazard.kernels`, in which every pair of members is evaluated once. The results
differ from those of `Hazard.rates` by rounding only. Several states are evaluated together.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._util.jit import generated_module
from ..errors import HazardError
from ..typing import FloatArray
from .base import Hazard
from .kernels import KernelHazard, differentiated_kernels

_RATES = """
@vectorized_objective
def rates(x, alive, constants, values, scratch):
    n, radars = int(constants[0]), int(constants[1])
    size = alive.size
    lanes = size // n
    parameters = {parameters}
    own_density = density(0.0, parameters)[0]
    densities, collisions = scratch[:size], scratch[size : 2 * size]
    for k in range(size):
        densities[k], collisions[k], values[k] = own_density, 0.0, 0.0
    for i in range(n):
        own = slice(i * lanes, (i + 1) * lanes)
        living, density_i, collision_i, source_i = (
            alive[own],
            densities[own],
            collisions[own],
            values[own],
        )
        east = x[2 * i * lanes : (2 * i + 1) * lanes]
        north = x[(2 * i + 1) * lanes : (2 * i + 2) * lanes]
        for j in range(i + 1, n):
            other = slice(j * lanes, (j + 1) * lanes)
            living_j, density_j, collision_j = alive[other], densities[other], collisions[other]
            east_j = x[2 * j * lanes : (2 * j + 1) * lanes]
            north_j = x[(2 * j + 1) * lanes : (2 * j + 2) * lanes]
            for k in range(lanes):
                de, dn = east[k] - east_j[k], north[k] - north_j[k]
                value = density(de * de + dn * dn, parameters)[0]
                density_i[k] += living_j[k] * value
                density_j[k] += living[k] * value
            if {collides}:
                for k in range(lanes):
                    de, dn = east[k] - east_j[k], north[k] - north_j[k]
                    value = collision(de * de + dn * dn, parameters)[0]
                    collision_i[k] += living_j[k] * value
                    collision_j[k] += living[k] * value
        for r in range(2, 2 + 3 * radars, 3):
            radar_east, radar_north, strength = constants[r], constants[r + 1], constants[r + 2]
            for k in range(lanes):
                de, dn = east[k] - radar_east, north[k] - radar_north
                source_i[k] += strength * source(de * de + dn * dn, parameters)[0]
    for k in range(size):
        values[k] = combine(values[k], densities[k], collisions[k], parameters)[0]
    return 0.0
"""


class CompiledRates(NamedTuple):
    """A function for kernels, ``rates(x, alive, constants, values, scratch)``.

    It writes the rates of L states to `values` (n, L), from positions `x` (n, 2, L) and `alive`
    (n, L), 1 or 0, all of them flat; entries of the destroyed have no meaning. `scratch` (2 n L,)
    is overwritten. It returns 0.

    Parameters
    ----------
    rates : compiled function
    constants : (s,)
        n, the number of radars, their positions and strengths, and parameters of the hazard.
    """

    rates: Any
    constants: FloatArray


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
    return CompiledRates(generated_module(f"{source}\n{rates}").rates, constants)

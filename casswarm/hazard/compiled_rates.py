"""Rates of all members of a state as a compiled function, for hazards that are made of kernels.

The sums of `casswarm.hazard.kernels`, in which every pair of members is evaluated once. The results
differ from those of `Hazard.rates` by rounding only.
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
@objective
def rates(x, alive, constants, values, scratch):
    n = alive.size
    radars = int(constants[0])
    parameters = constants[1 + 3 * radars :]
    own_density = density(0.0, parameters)[0]
    for i in range(n):
        scratch[2 * i], scratch[2 * i + 1], values[i] = own_density, 0.0, 0.0
    for i in range(n):
        if alive[i] == 0.0:
            continue
        east, north = x[2 * i], x[2 * i + 1]
        for j in range(i + 1, n):
            if alive[j] == 0.0:
                continue
            de, dn = east - x[2 * j], north - x[2 * j + 1]
            squared = de * de + dn * dn
            pair_density = density(squared, parameters)[0]
            pair_collision = collision(squared, parameters)[0]
            scratch[2 * i] += pair_density
            scratch[2 * j] += pair_density
            scratch[2 * i + 1] += pair_collision
            scratch[2 * j + 1] += pair_collision
        risk = 0.0
        for r in range(1, 1 + 3 * radars, 3):
            de, dn = east - constants[r], north - constants[r + 1]
            risk += constants[r + 2] * source(de * de + dn * dn, parameters)[0]
        values[i] = combine(risk, scratch[2 * i], scratch[2 * i + 1], parameters)[0]
    return 0.0
"""


class CompiledRates(NamedTuple):
    """A function for kernels, ``rates(x, alive, constants, values, scratch)``.

    It reads positions (2n,) and alive (n,), 1 or 0, and writes the rates (n,) to `values`, 0 for
    the destroyed; `scratch` has 2n entries. It returns 0.

    Parameters
    ----------
    rates : compiled function
    constants : (s,)
        Radars, strengths and parameters of the hazard.
    """

    rates: Any
    constants: FloatArray


def compiled_rates(hazard: Hazard) -> CompiledRates | None:
    """The compiled rates of a hazard.

    None for hazards that are not made of kernels, or of such as have no counterpart in Python.
    """
    if not isinstance(hazard, KernelHazard):
        return None
    try:
        source, parameters = differentiated_kernels(hazard)
    except HazardError:
        return None
    radars = np.column_stack([hazard.radar_positions, hazard.radar_strengths])
    constants = np.concatenate([[len(radars)], radars.ravel(), parameters])
    return CompiledRates(generated_module(f"{source}\n{_RATES}").rates, constants)

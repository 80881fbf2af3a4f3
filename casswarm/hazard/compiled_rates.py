"""Rates of all members of a state as a compiled function, for hazards that are made of kernels.

The sums of `casswarm.hazard.kernel_hazard`, in which every pair of members is evaluated once. The
results differ from those of `Hazard.rates` by rounding only. Several states are evaluated together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .._util.threads import locked_cache
from ..compiled.kernels import generated_module, specialised
from ..errors import HazardError
from ..typing import BoolArray, FloatArray
from .base import Hazard
from .codegen import differentiated_kernels, lower_source
from .kernel_hazard import KernelHazard

_LANES = 64  # states of a block: they fit in the first cache


@dataclass(frozen=True, eq=False)
class CompiledRates:
    """Rates of n members as a compiled function."""

    n: int
    source: str  # text of the function, which all hazards of a class share
    constants: FloatArray  # (s,), as of `rate_module`

    def __call__(self, positions: FloatArray, alive: BoolArray, rates: FloatArray) -> bool:
        """Write the rates (B, n) of states (B, n, 2), (B, n), 0 for the destroyed.

        Returns whether all of them are finite and not negative.
        """
        work = np.empty((6, self.n * min(len(alive), _LANES)))
        compiled = generated_module(self.source).write_rates
        return bool(compiled(alive, positions, self.constants, rates, work))


def compiled_rates(hazard: Hazard, n: int) -> CompiledRates | None:
    """The compiled rates of n members.

    None for hazards that are not made of kernels, or of such as have no counterpart in Python.
    """
    from .rate_kernels import write_block, write_rates

    found = rate_module(hazard, write_block, write_rates)
    return None if found is None else CompiledRates(n, *found)


def rate_module(
    hazard: Hazard, *kernels: Callable[..., Any], reordering: bool = False
) -> tuple[str, FloatArray] | None:
    """Text of a module of kernels that call those of a hazard, and the hazard's constants.

    These are its parameters, the position and strength of every radar and, where members differ,
    the exposures and densities of all.

    `casswarm.hazard.rate_kernels` has functions that stand for the hazard's. Where the kernels are
    `reordering`, their sums are in any order. None for hazards that are not made of kernels, or of
    such as have no counterpart in Python.
    """
    if not isinstance(hazard, KernelHazard):
        return None
    try:
        text, parameters = _module(hazard.template, kernels, reordering)
    except HazardError:
        return None
    radars = np.column_stack([hazard.radar_positions, hazard.radar_strengths])
    members = () if hazard.members is None else hazard.members
    return text, np.concatenate([parameters, radars.ravel(), *members])


@locked_cache(maxsize=64)
def _module(
    hazard: KernelHazard, kernels: tuple[Callable[..., Any], ...], reordering: bool
) -> tuple[str, tuple[float, ...]]:
    """Text of the module, and the hazard's parameters."""
    text, parameters = differentiated_kernels(hazard)
    symbols = ca.SX.sym("constants", len(parameters))
    unpacked = lower_source("unpacked", {"constants": symbols}, ca.vertsplit(symbols))
    text += f"\n\nCOLLIDES = {hazard.collides}\nHAS_ZONES = {bool(hazard.zones)}"
    text += f"\nDIFFER = {hazard.members is not None}"
    text += f"\nFIRST_RADAR = {len(parameters)}\n\n\n{unpacked}"
    return specialised(text, *kernels, reordering=reordering), parameters

"""The formation problem's objective as source for compiled solvers, for rates made of kernels.

The same sums as `casswarm.hazard.kernel_hazard` assembles in matrix form, member by member: the
objective of `casswarm.problems.formation` and its gradient, O(n) per member that has a weight. The
layout of x and p is that of `formation_nlp`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._util.threads import locked_cache
from ..compiled.kernels import generated_module
from ..errors import HazardError
from ..hazard import Hazard, KernelHazard
from ..hazard.kernel_hazard import differentiated_kernels
from ..nlp.program import Nlp
from ..problems.formation import formation_nlp
from ..typing import FloatArray
from .curvature import BLOCKS
from .pair_loops import EVALUATE
from .spectral_kernels import LARGE_SWARM


@dataclass(frozen=True, eq=False)
class CompiledObjective:
    """An objective and its gradient as Python source, for solvers with a compiled inner loop.

    Attached to programs; see `casswarm.nlp.Nlp.attached`.

    Parameters
    ----------
    source : str
        Text of ``evaluate(x, p, constants, gradient, scratch)``, decorated with ``@objective``, and
        of the ``@kernel`` functions that it calls: it returns f(x; p) and writes the gradient. All
        problems of a kind have the same source, which is compiled once. From
        `casswarm.formation.spectral_kernels.LARGE_SWARM` members on (pairs of coordinates of
        x), it may also write blocks: where `gradient` has 5n entries, the second derivatives (xx,
        xy, yy) of every member follow, which precondition Newton steps.
    constants : (s,)
        Numbers that all instances share, such as the positions of radars.
    """

    source: str
    constants: FloatArray

    @property
    def evaluate(self) -> Any:
        """The compiled function, to be passed to kernels."""
        return generated_module(self.source).evaluate


@dataclass(frozen=True)
class StartCount:
    """Number of initial guesses that batch solvers, for which they cost little, try by default.

    Attached to programs where local minima are common, whatever the form of their objective.
    """

    number: int


def start_count(nlp: Nlp) -> int:
    """The number of initial guesses that a program is worth: one, unless it says more."""
    attached = nlp.attached(StartCount)
    return 1 if attached is None else attached.number


@locked_cache(maxsize=32)
def formation_program(hazard: Hazard, n: int, corridor: bool, horizon: int = 1) -> Nlp:
    """The program of `formation_nlp` with what the batch solvers read."""
    nlp, compiled = formation_nlp(hazard, n, corridor, horizon), formation_objective(hazard, n)
    if compiled is not None:
        nlp = nlp.with_attachments(compiled)
    smooth = isinstance(hazard, KernelHazard) and not hazard.collides
    return nlp if smooth else nlp.with_attachments(StartCount(4))


_EVALUATE = """
@objective
def evaluate(x, p, constants, gradient, scratch):
    n = x.size // 2
    radars = int(constants[0])
    parameters = constants[1 + 3 * radars :]
    dt = p[6 * n + 2]
    density_sums, collision_sums, slopes = 2 * n, 3 * n, 4 * n  # where these begin in `scratch`
    for c in range(2 * n):
        scratch[c] = p[c] + dt * x[c]
        scratch[density_sums + c] = 0.0
        gradient[c] = 0.0
    k = slopes
    for i in range(n):
        if p[5 * n + i] == 0.0:
            continue
        east, north = scratch[2 * i], scratch[2 * i + 1]
        for j in range(n):
            weighted = p[5 * n + j] != 0.0
            if p[4 * n + j] == 0.0 or j == i or (weighted and j < i):
                continue
            de, dn = east - scratch[2 * j], north - scratch[2 * j + 1]
            squared = de * de + dn * dn
            pair_density, scratch[k] = density(squared, parameters)
            pair_collision, scratch[k + 1] = collision(squared, parameters)
            scratch[density_sums + i] += pair_density
            scratch[collision_sums + i] += pair_collision
            if weighted:
                scratch[density_sums + j] += pair_density
                scratch[collision_sums + j] += pair_collision
            k += 2
    total = 0.0
    own_density = density(0.0, parameters)[0]
    for i in range(n):
        weight = p[5 * n + i]
        if weight == 0.0:
            continue
        east, north = scratch[2 * i], scratch[2 * i + 1]
        risk, risk_east, risk_north = 0.0, 0.0, 0.0
        for r in range(1, 1 + 3 * radars, 3):
            de, dn, strength = east - constants[r], north - constants[r + 1], constants[r + 2]
            value, slope = source(de * de + dn * dn, parameters)
            risk += strength * value
            risk_east += strength * slope * de
            risk_north += strength * slope * dn
        rate, by_risk, by_density, by_collision = combine(
            risk, scratch[density_sums + i] + own_density, scratch[collision_sums + i], parameters
        )
        total += weight * rate
        gradient[2 * i] += 2.0 * dt * weight * by_risk * risk_east
        gradient[2 * i + 1] += 2.0 * dt * weight * by_risk * risk_north
        scratch[density_sums + i] = 2.0 * dt * weight * by_density
        scratch[collision_sums + i] = 2.0 * dt * weight * by_collision
    k = slopes
    for i in range(n):
        if p[5 * n + i] == 0.0:
            continue
        east, north = scratch[2 * i], scratch[2 * i + 1]
        for j in range(n):
            if p[4 * n + j] == 0.0 or j == i or (p[5 * n + j] != 0.0 and j < i):
                continue
            slope = (scratch[density_sums + i] + scratch[density_sums + j]) * scratch[k]
            slope += (scratch[collision_sums + i] + scratch[collision_sums + j]) * scratch[k + 1]
            de, dn = slope * (east - scratch[2 * j]), slope * (north - scratch[2 * j + 1])
            gradient[2 * i] += de
            gradient[2 * i + 1] += dn
            gradient[2 * j] -= de
            gradient[2 * j + 1] -= dn
            k += 2
    return total
"""
"""Objective of `x` (2n,) and its gradient, for positions, alive and weights in `p`.

Every pair of members is evaluated once. `scratch` (n (n + 8),) is overwritten. Text, because the
kernels that it calls are generated: compiled in one module with them, they are inlined.
"""


def formation_objective(hazard: Hazard, n: int) -> CompiledObjective | None:
    """The compiled objective; its constants are the hazard's radars, strengths and parameters.

    For large swarms, of n members, its loops are vectorised, and it also writes blocks of the
    Hessian. None for hazards that are not made of kernels, or of such as have no counterpart in
    Python.
    """
    if not isinstance(hazard, KernelHazard):
        return None
    try:
        source, parameters = differentiated_kernels(hazard)
    except HazardError:
        return None
    radars = np.column_stack([hazard.radar_positions, hazard.radar_strengths])
    constants = np.concatenate([[len(radars)], radars.ravel(), parameters])
    evaluate = _EVALUATE
    if n >= LARGE_SWARM:
        names = [f"constants[1 + 3 * radars + {i}]," for i in range(len(parameters))]
        evaluate = (BLOCKS + EVALUATE).format(
            collides=hazard.collides, parameters=f"({' '.join(names)})"
        )
    return CompiledObjective(f"{source}\n{evaluate}", constants)

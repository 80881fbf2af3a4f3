"""The formation problem's objective as source for compiled solvers, for rates made of kernels.

The same sums as `casswarm.hazard.kernels` assembles in matrix form, member by member: the objective
of `casswarm.problems.formation` and its gradient, O(n) per member that has a weight. The layout of
x and p is that of `formation_nlp`.
"""

from __future__ import annotations

import numpy as np

from ..errors import HazardError
from ..hazard import Hazard, KernelHazard
from ..hazard.kernels import differentiated_kernels
from ..optimization.problem import CompiledObjective

_EVALUATE = '''
@compiled
def evaluate(x, p, shared, gradient, scratch):
    """Objective of `x` (2n,) and its gradient, for positions, alive and weights in `p`.

    `scratch` (n (n + 8),) is overwritten. Every pair of members is evaluated once.
    """
    n = x.size // 2
    radars = int(shared[0])
    parameters = shared[1 + 3 * radars :]
    dt = p[6 * n + 2]
    crowd, crash, pairs = 2 * n, 3 * n, 4 * n  # where these begin in `scratch`
    for c in range(2 * n):
        scratch[c] = p[c] + dt * x[c]
        scratch[crowd + c] = 0.0
        gradient[c] = 0.0
    k = pairs
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
            near, scratch[k] = density(squared, parameters)
            hit, scratch[k + 1] = collision(squared, parameters)
            scratch[crowd + i] += near
            scratch[crash + i] += hit
            if weighted:
                scratch[crowd + j] += near
                scratch[crash + j] += hit
            k += 2
    total = 0.0
    alone = density(0.0, parameters)[0]  # a member counts in its own crowd
    for i in range(n):
        weight = p[5 * n + i]
        if weight == 0.0:
            continue
        east, north = scratch[2 * i], scratch[2 * i + 1]
        risk, risk_east, risk_north = 0.0, 0.0, 0.0
        for r in range(1, 1 + 3 * radars, 3):
            de, dn, strength = east - shared[r], north - shared[r + 1], shared[r + 2]
            value, slope = source(de * de + dn * dn, parameters)
            risk += strength * value
            risk_east += strength * slope * de
            risk_north += strength * slope * dn
        rate, by_risk, by_crowd, by_crash = combine(
            risk, scratch[crowd + i] + alone, scratch[crash + i], parameters
        )
        total += weight * rate
        gradient[2 * i] += 2.0 * dt * weight * by_risk * risk_east
        gradient[2 * i + 1] += 2.0 * dt * weight * by_risk * risk_north
        scratch[crowd + i] = 2.0 * dt * weight * by_crowd
        scratch[crash + i] = 2.0 * dt * weight * by_crash
    k = pairs
    for i in range(n):
        if p[5 * n + i] == 0.0:
            continue
        east, north = scratch[2 * i], scratch[2 * i + 1]
        for j in range(n):
            if p[4 * n + j] == 0.0 or j == i or (p[5 * n + j] != 0.0 and j < i):
                continue
            slope = (scratch[crowd + i] + scratch[crowd + j]) * scratch[k]
            slope += (scratch[crash + i] + scratch[crash + j]) * scratch[k + 1]
            de, dn = slope * (east - scratch[2 * j]), slope * (north - scratch[2 * j + 1])
            gradient[2 * i] += de
            gradient[2 * i + 1] += dn
            gradient[2 * j] -= de
            gradient[2 * j + 1] -= dn
            k += 2
    return total
'''


def formation_objective(hazard: Hazard) -> CompiledObjective | None:
    """The objective's source, and the hazard's numbers that it reads: radars and parameters.

    None for rates that are no composition of kernels, or whose kernels have no such source.
    """
    if not isinstance(hazard, KernelHazard):
        return None
    try:
        source, parameters = differentiated_kernels(hazard)
    except HazardError:
        return None
    radars = np.column_stack([hazard.radar_positions, hazard.radar_strengths])
    shared = np.concatenate([[len(radars)], radars.ravel(), parameters])
    return CompiledObjective(f"{source}\n{_EVALUATE}", shared)

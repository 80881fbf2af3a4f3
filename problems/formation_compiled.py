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
from ..nlp import CompiledObjective

_EVALUATE = '''
@compiled
def evaluate(x, p, shared, gradient):
    """Objective of `x` (2n,) and its gradient, for positions, alive and weights in `p`."""
    n = x.size // 2
    radars = int(shared[0])
    parameters = shared[1 + 3 * radars :]
    alive, weights, dt = p[4 * n : 5 * n], p[5 * n : 6 * n], p[6 * n + 2]
    place = np.empty(2 * n)
    for c in range(2 * n):
        place[c] = p[c] + dt * x[c]
        gradient[c] = 0.0
    pull = np.empty(n)  # by which member j draws on member i: d rate_i / d (squared distance)
    nudge = np.empty(n)
    total = 0.0
    for i in range(n):
        if weights[i] == 0.0:
            continue
        east, north = place[2 * i], place[2 * i + 1]
        risk, risk_east, risk_north = 0.0, 0.0, 0.0
        for r in range(radars):
            de, dn = east - shared[1 + 3 * r], north - shared[2 + 3 * r]
            value, slope = source(de * de + dn * dn, parameters)
            strength = shared[3 + 3 * r]
            risk += strength * value
            risk_east += 2.0 * strength * slope * de
            risk_north += 2.0 * strength * slope * dn
        crowd, crash = 0.0, 0.0
        for j in range(n):
            pull[j], nudge[j] = 0.0, 0.0
            if alive[j] != 0.0:
                de, dn = east - place[2 * j], north - place[2 * j + 1]
                value, pull[j] = density(de * de + dn * dn, parameters)
                crowd += alive[j] * value
                if j != i:
                    value, nudge[j] = collision(de * de + dn * dn, parameters)
                    crash += alive[j] * value
        rate, by_risk, by_crowd, by_crash = combine(risk, crowd, crash, parameters)
        total += weights[i] * rate
        gradient[2 * i] += weights[i] * by_risk * risk_east
        gradient[2 * i + 1] += weights[i] * by_risk * risk_north
        for j in range(n):
            if j != i and alive[j] != 0.0:
                slope = 2.0 * weights[i] * alive[j] * (by_crowd * pull[j] + by_crash * nudge[j])
                de, dn = east - place[2 * j], north - place[2 * j + 1]
                gradient[2 * i] += slope * de
                gradient[2 * i + 1] += slope * dn
                gradient[2 * j] -= slope * de
                gradient[2 * j + 1] -= slope * dn
    for c in range(2 * n):
        gradient[c] *= dt
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

"""The paper's rates, sum by sum, and random states to try hazards on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from casswarm.hazard import Hazard, Saturation, SaturationCollision

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def by_loops(hazard: Saturation, x: Array, alive: Mask) -> Array:
    """Equations (8) and (9), and Scenario II's collisions, for the destroyed too.

    As design.md reads the paper's sums over j: j = i counts in the density, but nobody collides
    with himself or with the destroyed.
    """
    strengths = hazard.strengths or [1.0] * len(hazard.radars)
    exposures, densities = hazard.members or [[1.0] * len(x)] * 2
    rates = []
    for i in range(len(x)):
        density = 0.0
        for j in range(len(x)):
            if alive[j]:
                density += densities[j] / (1 + hazard.alpha_3 * math.dist(x[i], x[j]) ** 2)
        rate = 0.0
        for strength, radar in zip(strengths, hazard.radars, strict=True):
            saturated = hazard.alpha_1 * (1 + hazard.alpha_2 * density) ** -1
            rate += exposures[i] * strength * saturated / math.dist(x[i], radar) ** 2
        if isinstance(hazard, SaturationCollision):
            for j in range(len(x)):
                if alive[j] and j != i:
                    rate += (hazard.beta_1 / math.dist(x[i], x[j])) ** hazard.beta_2
        rates.append(rate)
    return np.array(rates)


def symbolic(hazard: Hazard, n: int) -> Any:
    """CasADi Function (2, n), (1, n) to rates (1, n), their Jacobian, and their sum's Hessian."""
    x, alive = ca.MX.sym("x", 2, n), ca.MX.sym("alive", 1, n)
    rates = hazard.expression(x, alive)
    hessian = ca.hessian(ca.sum2(rates), x)[0]
    return ca.Function("rates", [x, alive], [rates, ca.jacobian(rates, x), hessian])


@dataclass(frozen=True)
class State:
    """Members at positions (n, 2), of whom some are alive (n,), in the field of a hazard."""

    hazard: Saturation
    positions: Array
    alive: Mask


@st.composite
def states(draw: st.DrawFn, n_max: int = 6, differ: bool = True) -> State:
    """Random states, random constants; all points lie apart, on a grid of sixty-fourths.

    Members may differ.

    So all distances exceed `CORE_RADIUS`, and differences of coordinates are exact.
    """
    n, k = draw(st.integers(1, n_max)), draw(st.integers(1, 3))
    coordinate = st.integers(-256, 256).map(lambda whole: whole / 64)
    pairs = st.tuples(coordinate, coordinate)
    points = draw(st.lists(pairs, min_size=n + k, max_size=n + k, unique=True))
    alive = np.array(draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    factor = st.floats(0.1, 10)
    constants: dict[str, Any] = {name: draw(factor) for name in ("alpha_1", "alpha_2", "alpha_3")}
    constants["alpha_2"] *= draw(st.integers(0, 1))
    if draw(st.booleans()):
        constants["strengths"] = tuple(draw(factor) for _ in range(k))
    if draw(st.booleans()):
        betas: dict[str, Any] = {
            "beta_1": draw(st.floats(0.05, 0.5)),
            "beta_2": draw(st.floats(1, 8)),
        }
        hazard: Saturation = SaturationCollision(tuple(points[n:]), **constants, **betas)
    else:
        hazard = Saturation(tuple(points[n:]), **constants)
    if differ and draw(st.booleans()):
        factors = st.tuples(*[factor] * n)
        hazard = hazard.with_members(draw(factors), draw(factors))
    return State(hazard, np.array(points[:n]), alive)

"""The guide as the paper writes it: penalised, by single shooting, for the projected gradient.

    minimise  -exp(-sum over t = 1..tau of dt lambda-bar(X(t))) + gamma d(X(N))
    over      V(0..N-1) in [-v_max, v_max]^(2N),   X(t+1) = X(t) + dt V(t)

The sign of the first term is corrected from the paper's. tau is the arrival step, equation (2): the
first t with X(t) in the target, or N. It is piecewise constant in V, so its derivative is zero. d
is the distance to the target zone, max(0, ||x - c|| - radius), written so that its gradient exists
at the centre. The paper's guide problem has no acceleration limit.
"""

from __future__ import annotations

import casadi as ca

from .._util.threads import locked_cache
from ..hazard import Hazard
from ..optimization.problem import Instances, Nlp
from ..typing import FloatArray
from .guide import UNROLL, GuideTask


@locked_cache(maxsize=16)
def penalised_guide_nlp(hazard: Hazard, horizon: int) -> Nlp:
    """The program above with `horizon` = N steps."""
    V = ca.MX.sym("velocities", 2, horizon)
    start, center = ca.MX.sym("start", 2), ca.MX.sym("center", 2)
    radius, gamma, dt = (ca.MX.sym(name) for name in ("radius", "gamma", "dt"))
    X = ca.repmat(start, 1, horizon) + dt * ca.cumsum(V, 1)
    squared = ca.sum1((X - ca.repmat(center, 1, horizon)) ** 2)
    inside = squared <= radius**2
    underway = (ca.cumsum(inside, 1) - inside) < 0.5  # not arrived before this step
    risk = ca.dot(underway, dt * hazard.single_agent_expression(X))
    distance = ca.sqrt(ca.fmax(squared[-1], radius**2)) - radius
    return Nlp(
        name=f"penalised guide[{horizon}]",
        variables={"velocities": V},
        parameters={"start": start, "center": center, "radius": radius, "gamma": gamma, "dt": dt},
        objective=-ca.exp(-risk) + gamma * distance,
        constraints={},
        unroll=horizon * max(1, len(hazard.radar_positions)) <= UNROLL,
    )


def penalised_guide_instance(
    nlp: Nlp, task: GuideTask, gamma: float, velocities: FloatArray
) -> Instances:
    """Instance of one agent's task, with `velocities` (N, 2) as initial guess."""
    return Instances(
        x0=nlp.pack_variables(velocities=velocities[None]),
        p=nlp.pack_parameters(
            start=task.start[None],
            center=task.center[None],
            radius=task.radius,
            gamma=gamma,
            dt=task.dt,
        ),
        lbx=nlp.pack_variables(velocities=-task.v_max),
        ubx=nlp.pack_variables(velocities=task.v_max),
        lbg=nlp.pack_constraints(),
        ubg=nlp.pack_constraints(),
    )

"""The guide: the path of a single agent with the least risk, constrained or penalised.

The paper's section III as a nonlinear program, by direct multiple shooting:

    minimise    sum over t = 1..T of dt lambda-bar(X(t))
    over        X(1..T), V(0..T-1)
    subject to  X(t+1) = X(t) + dt V(t)                    equation (3)
                -v_max <= V(t) <= v_max                     equation (4)
                ||V(t)||^2 <= v_max^2                       if the speed has this limit, too
                ||V(t) - V(t-1)||^2 <= a_max                if acceleration_limited
                ||X(T) - c||^2 <= (radius - margin)^2

The paper writes *min* exp(-sum) + gamma d, which has a wrong sign: survival is to be maximised, and
the risk, minus its logarithm, is the better scaled objective. V(-1) is a parameter, and the change
from it has its own limit, infinite if the guide may start with any velocity.

**Hazards that are not known.** With K cases of priors p_k and risks R_k, the sums above, the
objective is -log sum_k p_k exp(-R_k), minus the logarithm of the mean survival. The R_k are
variables, equal to the sums above, so that second derivatives stay sparse.

Where rates depend on time, lambda-bar(X(t)) is that of the radars after t steps. With m substeps it
is the mean of the rates at m points of the straight line from X(t-1) to X(t), of which X(t) is the
last.

One program with `horizon` steps serves every arrival step T <= horizon: the risk of the steps after
T has weight zero, and their velocities are fixed at zero.

**The paper's penalised form**, by single shooting, for the projected gradient:

    minimise  -exp(-sum over t = 1..tau of dt lambda-bar(X(t))) + gamma d(X(N))
    over      V(0..N-1) in [-v_max, v_max]^(2N),   X(t+1) = X(t) + dt V(t)

The sign of the first term is corrected as above. tau is the arrival step, equation (2): the
first t with X(t) in the target, or N. It is piecewise constant in V, so its derivative is zero. d
is the distance to the target zone, max(0, ||x - c|| - radius), written so that its gradient exists
at the centre. The paper's guide problem has no acceleration limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from .._util.threads import locked_cache
from ..hazard import Hazard
from ..nlp.program import Instances, Nlp
from ..typing import Expr, FloatArray

if TYPE_CHECKING:
    from ..scenario import Scenario


TIGHTENING = 1e-7
"""Relative tightening of squared limits, so that solutions within a solver's tolerance satisfy the
exact limits of the chain."""

UNROLL = 3000
"""Steps times radars up to which scalar expressions are faster."""


@locked_cache(maxsize=16)
def guide_nlp(
    hazard: Hazard | tuple[Hazard, ...], horizon: int, substeps: int = 1, disc: bool = False
) -> Nlp:
    """The program above for arrival at any step up to `horizon`, with a tuple of hazards its cases.

    Where there are `substeps`, ``hazard.after`` counts them. With a `disc`, the speed is limited in
    every direction.

    Positions are relative to the start; units are steps and lengths of a step at v_max, because
    solvers' tolerances are absolute and a solve must not depend on the scenario's units.
    """
    X = ca.MX.sym("positions", 2, horizon)
    V = ca.MX.sym("velocities", 2, horizon)
    center, initial_velocity = ca.MX.sym("center", 2), ca.MX.sym("initial_velocity", 2)
    weights, origin = ca.MX.sym("weights", 1, horizon), ca.MX.sym("origin", 2)
    length, clock = ca.MX.sym("length"), ca.MX.sym("clock")
    previous = ca.horzcat(ca.DM.zeros(2), X[:, :-1])
    parts = [X if k == substeps else previous + k / substeps * (X - previous)
             for k in range(1, substeps + 1)]  # fmt: skip
    points = ca.reshape(ca.vertcat(*parts), 2, substeps * horizon)
    places = ca.repmat(origin, 1, substeps * horizon) + length * points

    def risk(of: Hazard) -> Expr:
        rates = of.expression_along(places)
        if substeps > 1:
            total: Expr = ca.sum1(ca.reshape(rates, substeps, horizon))
            rates = total / substeps
        return ca.dot(weights, clock * rates)

    cases = hazard if isinstance(hazard, tuple) else (hazard,)
    change = V - ca.horzcat(initial_velocity, V[:, :-1])
    symbols = [initial_velocity, center, weights, origin, length, clock]
    size = [str(horizon), *([str(substeps)] if substeps > 1 else []), *(["disc"] if disc else [])]
    more, equal = {}, {}
    if hazard is cases:
        size.append(f"{len(cases)} cases")
        symbols.append(ca.MX.sym("log_prior", len(cases)))
        more = {"risks": ca.MX.sym("risks", len(cases))}
        equal = {"risk": more["risks"] - ca.vertcat(*map(risk, cases))}
        objective = -ca.logsumexp(symbols[-1] - more["risks"])
    else:
        objective = risk(cases[0])
    radars = sum(max(1, len(case.radar_positions)) for case in cases)
    return Nlp(
        name=f"guide[{', '.join(size)}]",
        variables={"positions": X, "velocities": V, **more},
        parameters={symbol.name(): symbol for symbol in symbols},
        objective=objective,
        constraints={
            "dynamics": X - previous - V,
            "acceleration": ca.sum1(change**2),
            "arrival": ca.sumsqr(X[:, -1] - center),
            **({"speed": ca.sum1(V**2)} if disc else {}),
            **equal,
        },
        unroll=hazard is not cases and substeps * horizon * radars <= UNROLL,
    )


@dataclass(frozen=True, eq=False)
class GuideTask:
    """A single agent's task.

    Parameters
    ----------
    start, center : (2,)
        The agent's position, and the target's centre.
    radius : float
        Maximum distance from the centre on arrival (the margin already subtracted).
    initial_velocity : (2,)
        V(-1).
    a_max, a_max_first : float
        Bounds on ||V(t) - V(t-1)||^2 for t >= 1, and for t = 0; may be infinite.
    v_max, dt : float
    disc : bool
        Whether v_max bounds the speed in every direction.
    """

    start: FloatArray
    center: FloatArray
    radius: float
    initial_velocity: FloatArray
    a_max: float
    a_max_first: float
    v_max: float
    dt: float
    disc: bool = False

    def limited(self, velocities: FloatArray) -> FloatArray:
        """Velocities (..., 2) shortened to the limits of speed."""
        if not self.disc:
            return np.clip(velocities, -self.v_max, self.v_max)
        length = np.hypot(velocities[..., 0], velocities[..., 1])[..., None]
        return velocities * np.minimum(1.0, self.v_max / np.maximum(length, 1e-300))

    @classmethod
    def from_scenario(
        cls, scenario: Scenario, start: ArrayLike, initial_velocity: ArrayLike | None = None
    ) -> GuideTask:
        """Task of an agent at `start` (2,); without `initial_velocity` (2,), it may be any."""
        velocity = np.zeros(2) if initial_velocity is None else initial_velocity
        free = initial_velocity is None or not scenario.guide.acceleration_limited
        return cls(
            start=np.asarray(start, float),
            center=np.asarray(scenario.target.center, float),
            radius=scenario.target.radius - scenario.arrival_margin,
            initial_velocity=np.asarray(velocity, float),
            a_max=scenario.guide_a_max,
            a_max_first=np.inf if free else scenario.swarm.a_max,
            v_max=scenario.swarm.v_max,
            dt=scenario.time.dt,
            disc=scenario.swarm.speed == "disc",
        )


def guide_instance(
    nlp: Nlp,
    task: GuideTask,
    arrival: int,
    velocities: FloatArray,
    scale: float = 1.0,
    cases: tuple[FloatArray, FloatArray] | None = None,
) -> Instances:
    """Instance that arrives at step `arrival`, with the path of `velocities` as initial guess.

    Parameters
    ----------
    nlp : Nlp
        From `guide_nlp`, with a horizon of at least `arrival`.
    task : GuideTask
    arrival : int
        T >= 1.
    velocities : (arrival, 2)
        Initial guess; clipped to the box.
    scale : float
        Factor of the risk, for solvers whose tolerances and barriers are absolute.
    cases : pair of (K,), optional
        Of a program with several cases: their probabilities, positive, and guesses of their risks.
    """
    horizon, length = nlp.parameters["weights"].shape[1], task.dt * task.v_max
    moving = np.arange(horizon) < arrival
    guess = np.zeros((horizon, 2))
    guess[:arrival] = task.limited(velocities) / task.v_max
    limit = np.where(moving[:, None], 1.0, 0.0)
    a_max = np.where(moving, task.a_max, np.inf)
    a_max[0] = task.a_max_first
    disc = ["speed"] if task.disc else []
    more, free, equal = {}, {}, {}
    if cases is not None:
        more, free, equal = {"risks": cases[1][None]}, {"risks": np.inf}, {"risk": 0.0}
    return Instances(
        x0=nlp.pack_variables(positions=np.cumsum(guess, axis=0), velocities=guess, **more),
        p=nlp.pack_parameters(
            initial_velocity=task.initial_velocity[None] / task.v_max,
            center=(task.center - task.start)[None] / length,
            weights=scale * moving[:, None],
            origin=task.start[None],
            length=length,
            clock=task.dt,
            **({} if cases is None else {"log_prior": np.log(cases[0])[None]}),
        ),
        lbx=nlp.pack_variables(
            positions=-np.inf, velocities=-limit, **{name: -bound for name, bound in free.items()}
        ),
        ubx=nlp.pack_variables(positions=np.inf, velocities=limit, **free),
        lbg=nlp.pack_constraints(
            dynamics=0.0,
            acceleration=-np.inf,
            arrival=-np.inf,
            **dict.fromkeys(disc, -np.inf),
            **equal,
        ),
        ubg=nlp.pack_constraints(
            dynamics=0.0,
            acceleration=tightened(a_max / task.v_max**2)[:, None],
            arrival=tightened((task.radius / length) ** 2),
            **dict.fromkeys(disc, tightened(1.0)),
            **equal,
        ),
    )


def tightened(limit: float | FloatArray) -> FloatArray:
    """Squared limits less `TIGHTENING`, or less half if small; infinite ones stay."""
    return np.asarray(limit * (1 - np.minimum(0.5, TIGHTENING * np.maximum(1.0, 1.0 / limit))))


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
    risk = ca.dot(underway, dt * hazard.expression_along(X))
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

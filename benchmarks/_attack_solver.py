"""Claims about the formation solver: its reported residuals, and its answers against Ipopt's."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from _attack_model import Rates, project
from _attack_records import Check, Skip
from _attack_scenarios import Rng, draw, limits_of
from scipy.optimize import nnls

import casswarm as csw
from casswarm.formation.task import Formation, corridor_formation, leader_formation
from casswarm.motion.step import Motion, Step
from casswarm.solvers import make_solver

_STATES = 6
_STATIONARITY = 1e-6  # `auto` accepts answers up to here
_SAME = 1e-2  # of v_max: an end of Ipopt within it is the same minimum


def solver(rng: Rng) -> Iterator[Check]:
    """Claim 6: residuals are as reported, and Ipopt from the answer finds none better near it."""
    scenario = draw(rng).replace(swarm={"speed": "box"})
    corridor = bool(rng.random() < 0.5)
    step = _states(rng, scenario)
    if corridor:
        formation = corridor_formation(step, scenario.formation.rho)
    else:
        leaders = np.array([rng.choice(np.flatnonzero(row)) for row in step.alive])
        formation = leader_formation(step, leaders)
    if not formation.free.any():
        raise Skip("no member is free")
    kind = "corridor" if corridor else "leader"
    instances, nlp = formation.instances, formation.nlp
    answer = make_solver("auto").solve_batch(nlp, instances)
    objective = _objective(scenario)
    again = make_solver("ipopt").solve_batch(nlp, instances.with_x0(answer.x))
    for row in range(_STATES):
        scale = float(instances.scale[row, 1])
        value, gradient = objective(step, formation, row, answer.x[row])
        detail = f"{kind}: {value!r}, {answer.objective[row]!r}"
        error = abs(value - answer.objective[row]) / max(scale, abs(value))
        yield Check("solver, objective", error, 1e-9, detail)
        if not answer.success[row] or not formation.free[row].any():
            part = "solver, not solved" if formation.free[row].any() else "solver, none free"
            yield Check(part, 0.0)
            continue
        yield from _residuals(formation, row, answer.x[row], gradient, kind)
        v_max = float(instances.scale[row, 0])
        other = formation.sets[row].project(again.x[row].reshape(-1, 2)).ravel()
        distance = float(np.abs(other - answer.x[row]).max()) / v_max
        if again.success[row] and distance <= _SAME:
            gain = (value - objective(step, formation, row, other)[0]) / max(scale, abs(value))
            yield Check("solver, Ipopt", gain, 1e-6, f"{kind}: {detail}")
        elif again.success[row]:
            better = again.objective[row] < answer.objective[row] - 1e-6 * max(scale, abs(value))
            yield Check(
                f"solver, Ipopt ends elsewhere, {'better' if better else 'not better'}", 0.0
            )


def _states(rng: Rng, scenario: csw.Scenario) -> Step:
    """Random states behind a random goal, some members lost."""
    n, v_max, dt = scenario.n, scenario.swarm.v_max, scenario.time.dt
    unit, shape = v_max * dt, (_STATES, n, 2)
    way = np.array(scenario.target.center) - scenario.positions[0]
    goal = scenario.positions[0] + rng.random() * way
    alive = rng.random((_STATES, n)) < 0.8
    alive[np.arange(_STATES), rng.integers(n, size=_STATES)] = True
    spread = unit * 10 ** rng.uniform(-2, 0.3)
    positions = goal - 0.5 * unit * rng.random(2) + spread * rng.normal(size=shape)
    if rng.random() < 0.2:
        positions[:] = positions[:, :1]  # coincident members
    fastest = limits_of(scenario)[0]
    previous = np.clip(v_max * rng.normal(scale=0.5, size=shape), -fastest, fastest)
    living = alive[..., None]
    return Step(
        scenario.hazard,
        Motion.from_scenario(scenario),
        np.where(living, positions, 0.0),
        np.where(living, previous, 0.0),
        alive,
        goal[None],
    )


def _objective(scenario: csw.Scenario):
    """Objective and gradient of a formation from the equations, by CasADi."""
    rates, n, dt = Rates.from_scenario(scenario), scenario.n, scenario.time.dt
    x, v = ca.SX.sym("x", 2, n), ca.SX.sym("v", 2, n)
    alive, weights = ca.SX.sym("alive", n), ca.SX.sym("weights", n)

    def core(squared: ca.SX) -> ca.SX:
        inside = (rates.core**2 + squared**2 / rates.core**2) / 2
        return ca.if_else(squared >= rates.core**2, squared, inside)

    following, total = x + dt * v, ca.SX(0)
    for i in range(n):
        source, density, collision = ca.SX(0), ca.SX(rates.kinds[i].density), ca.SX(0)
        for radar, strength in zip(rates.radars, rates.strengths, strict=True):
            source += rates.alpha[0] * strength / core(ca.sumsqr(following[:, i] - radar))
        for zone in scenario.hazard_table.regions:
            source += (1 + rates.alpha[1]) * zone.rates(following[0, i], following[1, i])
        for j in range(n):
            if j != i:
                squared = ca.sumsqr(following[:, i] - following[:, j])
                density += alive[j] * rates.kinds[j].density / (1 + rates.alpha[2] * squared)
                if rates.beta is not None:
                    one, two = rates.beta
                    collision += alive[j] * (one**2 / core(squared)) ** (two / 2)
        source *= rates.kinds[i].exposure
        total += weights[i] * (source / (1 + rates.alpha[1] * density) + collision)
    function = ca.Function("f", [x, v, alive, weights], [total, ca.gradient(total, ca.vec(v))])

    def evaluate(step: Step, formation: Formation, row: int, u: np.ndarray) -> tuple:
        start = 5 * n  # of p: positions, previous velocities, alive, weights
        chosen = formation.instances.p[row, start : start + n]
        value, slope = function(
            step.positions[row].T, u.reshape(n, 2).T, step.alive[row].astype(float), chosen
        )
        return float(value), np.array(slope).reshape(n, 2)

    return evaluate


def _residuals(
    formation: Formation, row: int, x: np.ndarray, gradient: np.ndarray, kind: str
) -> Iterator[Check]:
    """Violation and stationarity of the members that are free, from one of two proofs.

    Stationary is where ||x - P(x - gradient)|| is small, or the part of the gradient that is not a
    combination of the outward normals of active limits.
    """
    sets, free = formation.sets[row], formation.free[row]
    v_max, rate = formation.instances.scale[row]
    velocities, slope = x.reshape(-1, 2)[free], gradient[free] * v_max**2 / rate
    lower, upper = sets.lower[free], sets.upper[free]
    centers, radii = sets.centers[free], sets.radii[free]
    offsets = velocities[:, None] - centers
    outside = np.hypot(offsets[..., 0], offsets[..., 1]) - radii
    violation = max(
        float(np.maximum(lower - velocities, velocities - upper).max()), float(outside.max())
    )
    yield Check("solver, violation", violation / v_max, 1e-6, kind)
    ahead = project(velocities - slope, lower, upper, centers, radii)
    errors = np.abs(ahead - velocities).max(axis=1) / v_max
    for i in np.flatnonzero(errors > _STATIONARITY):  # the projection may not have converged
        limits = lower[i], upper[i], offsets[i], radii[i]
        errors[i] = min(errors[i], _normal_error(velocities[i], slope[i], limits, v_max) / v_max)
    yield Check("solver, stationarity", float(errors.max()), 2 * _STATIONARITY, kind)


def _normal_error(
    velocity: np.ndarray, slope: np.ndarray, limits: tuple[np.ndarray, ...], v_max: float
) -> float:
    """Distance from the projection of velocity - slope, by the normals of the active limits."""
    lower, upper, offsets, radii = limits
    lengths = np.hypot(offsets[:, 0], offsets[:, 1])
    normals = np.concatenate(
        [np.eye(2), -np.eye(2), offsets / np.maximum(lengths, 1e-300)[:, None]]
    )
    slack = np.concatenate([upper - velocity, velocity - lower, radii - lengths])
    active = slack <= 1e-9 * v_max
    if not active.any():
        return np.inf
    residual = float(nnls(normals[active].T, -slope)[1])
    if active[:4].any():
        return residual
    radius = float(radii[active[4:]].max())  # along a circle, the projection turns by an angle
    return residual * radius / (radius + float(np.hypot(*slope)))

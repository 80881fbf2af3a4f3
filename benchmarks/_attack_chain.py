"""Claims about the chain: exact evaluation, sampled intervals, and the limits of every step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from _attack_model import enumerate_chain
from _attack_records import Check, Skip, Trial
from _attack_scenarios import Rng, draw, in_time, late, limits_of, policies
from scipy.stats import binom

import casswarm as csw
from casswarm.chain.states import States
from casswarm.chain.transition import Transition, transition
from casswarm.guide.agent import initial_velocities

_LEVEL = 1e-7
_RUNS = 3000
_STATES = 20_000
_TOLERANCE = 1e-5


def enumeration(rng: Rng) -> Iterator[Check]:
    """Claim 3: exact evaluation agrees with an enumeration from the equations, and sampling.

    Of exact commands: rounded motion has no equations but its own.
    """
    scenario = late(rng, in_time(rng, draw(rng, members=(1, 3), steps=(1, 4))))
    guide = csw.plan(scenario, certify=False)
    velocities = initial_velocities(scenario, guide)
    name = str(rng.choice(policies(scenario, 2)))
    policy = csw.make_policy(name, scenario, guide)
    commands: dict[str, Any] = {"guide": guide, "aggregation_tol": 0.0}
    exact = csw.evaluate(scenario, policy, 0.0, **commands)
    truth = enumerate_chain(scenario, policy, velocities)
    for part in ("arrival", "survivors", "members"):
        ours, theirs = getattr(exact, part), getattr(truth, part)
        error = float(np.abs(ours - theirs).max())
        yield Check(f"enumeration, {part}", error, 1e-9, f"{name}: {ours} is not {theirs}")
    yield Check("enumeration, mass", exact.residual_mass, 0.0, f"{name}: not complete")
    tolerance, budget = 10 ** rng.uniform(-3, -0.5), int(10 ** rng.uniform(0, 4))
    coarse = csw.evaluate(scenario, policy, tolerance, max_states=budget, **commands)
    low, high = coarse.success
    success = float(truth.arrival.sum())
    outside = max(low - success, success - high)
    for part in ("arrival", "survivors", "members"):
        missing = getattr(truth, part) - getattr(coarse, part)
        outside = max(outside, -missing.min(), missing.max() - coarse.residual_mass)
    yield Check(
        "enumeration, bounds", max(low - success, success - high), 1e-9, f"{name}: {coarse}"
    )
    study = csw.simulate(scenario, policy, _RUNS, int(rng.integers(1 << 30)), guide=guide)
    yield _sampled(study, (success, success), name)._replace(part="enumeration, sampling")


def sampling(rng: Rng) -> Iterator[Check]:
    """Claim 3: the fraction of successful runs is likely under the bounds, for larger swarms.

    Of exact commands: rounded motion may decide otherwise where two decisions are nearly equal.
    """
    scenario = late(rng, in_time(rng, draw(rng, members=(2, 4), steps=(4, 12))))
    guide = csw.plan(scenario, certify=False)
    name = str(rng.choice(policies(scenario)))
    policy = csw.make_policy(name, scenario, guide)
    exact = {"guide": guide, "aggregation_tol": 0.0}
    bounds = csw.evaluate(scenario, policy, 1e-3, max_states=_STATES, **exact).success
    study = csw.simulate(scenario, policy, _RUNS, int(rng.integers(1 << 30)), guide=guide)
    yield _sampled(study, (bounds.low, bounds.high), name)


def _sampled(study: csw.Study, bounds: tuple[float, float], name: str) -> Check:
    """Whether the number of successes is possible for a probability within the bounds."""
    successes = int(study.summary["successes"][0])
    low, high = (min(1.0, max(0.0, bound)) for bound in (bounds[0] - 1e-9, bounds[1] + 1e-9))
    few, many = binom.cdf(successes, _RUNS, low), binom.sf(successes - 1, _RUNS, high)
    detail = f"{name}: {successes} of {_RUNS}, probability {bounds}"
    return Check("sampling", -float(min(few, many)), -_LEVEL, detail)


def intervals(rng: Rng) -> Iterator[Trial]:
    """Claim 4: 95 % intervals of `simulate` and `estimate` contain the exact success."""
    scenario = late(rng, draw(rng, members=(1, 3), steps=(3, 9)))
    guide = csw.plan(scenario, certify=False)
    policy = csw.make_policy(str(rng.choice(policies(scenario))), scenario, guide)
    exact = csw.evaluate(scenario, policy, _TOLERANCE, max_states=_STATES, guide=guide)
    if not exact.complete:
        raise Skip("exact bounds too wide")
    truth = exact.success
    if truth.low < 1e-3 or truth.high > 1 - 1e-3:
        raise Skip("success nearly certain, or nearly impossible")
    runs = int(10 ** rng.uniform(1.7, 3))
    for _ in range(5):
        seed = int(rng.integers(1 << 40))
        row = csw.simulate(scenario, policy, runs, seed, guide=guide).summary.loc[0]
        missed = row["success_low"] > truth.high or row["success_high"] < truth.low
        yield Trial("simulate", bool(missed))
        budget = int(rng.integers(1, 30))
        estimate = csw.estimate(scenario, policy, runs, seed, max_states=budget, guide=guide)
        low, high = estimate.success
        if estimate.runs:
            yield Trial("estimate", bool(low > truth.high or high < truth.low))


def limits(rng: Rng) -> Iterator[Check]:
    """Claim 5: applied velocities keep all limits, and the infeasible are those who miss."""
    scenario = draw(rng, steps=(2, 14)).replace(swarm={"speed": "box"})
    guide = csw.plan(scenario, certify=False)
    name = str(rng.choice([*policies(scenario, 3), "pushing"]))
    if name == "pushing":
        speed = scenario.swarm.v_max * 10 ** rng.uniform(-1, 9)
        policy = csw.as_policy(lambda t, x, _v, _a: speed * np.cos(t + 3 * x), name=name)
    else:
        policy = csw.make_policy(name, scenario, guide)
    states = States.initial(scenario, initial_velocities(scenario, guide))[np.zeros(8, int)]
    for step in range(scenario.n_steps):
        move = transition(scenario, policy, step, states)
        yield from _within(scenario, states, move, name)
        if name in ("leader", "constrained"):
            yield _infeasible(scenario, guide, policy, step, states, move)
        survives = states.alive & (rng.random(states.alive.shape) < move.survival)
        keep = survives[..., None]
        states = States(
            np.where(keep, move.positions, 0.0),
            np.where(keep, move.velocities, 0.0),
            survives,
            states.weights,
        )[survives.any(axis=1)]
        if not len(states):
            break


def _within(scenario: csw.Scenario, states: States, move: Transition, name: str) -> Iterator[Check]:
    """Limits of speed and acceleration, dynamics and probabilities of a step."""
    alive = states.alive
    v_max, a_max = (limit + 0 * alive[..., None] for limit in limits_of(scenario))
    speed = float((np.abs(move.velocities) / v_max)[alive].max()) - 1
    yield Check("limits, speed", speed, 2e-12, name)
    change = np.linalg.norm(move.velocities - states.previous_velocities, axis=-1)[..., None]
    excess = float(((change - np.sqrt(a_max)) / v_max)[alive].max())
    yield Check("limits, acceleration", excess, 2e-12, name)
    following = states.positions + scenario.time.dt * move.velocities
    yield Check(
        "limits, dynamics", float(np.abs(following - move.positions)[alive].max()), 0.0, name
    )
    survival = move.survival[alive]
    outside = float(np.maximum(-survival, survival - 1).max())
    yield Check("limits, probability", outside, 0.0, name)


def _infeasible(
    scenario: csw.Scenario,
    guide: csw.Guide,
    policy: csw.Policy,
    step: int,
    states: States,
    move: Transition,
) -> Check:
    """Difference between the number counted as infeasible and that of those who miss.

    Members within a relative 1e-5 of the soft constraint's edge may be counted or not.
    """
    goal = guide.reference(step + 1)
    distance = np.hypot(*np.moveaxis(move.positions - goal, -1, 0))
    counted = states.alive
    width = 0.0
    if policy.name == "leader":
        leaders = policy.leaders(step, states.positions, states.previous_velocities, states.alive)
        counted = counted & (np.arange(scenario.n) == leaders[:, None])
    else:
        width = float(np.sqrt(scenario.formation.rho))
    unit = scenario.swarm.v_max * scenario.time.dt
    edge = 1e-5 * (width + unit) + 8e-16 * float(np.abs(goal).max())
    least = (counted & (distance > width + edge)).sum(axis=1)
    most = (counted & (distance > width - edge)).sum(axis=1)
    found = move.counts["infeasible"]
    error = int(np.maximum(least - found, found - most).max())
    return Check("limits, infeasible", error, 0.0, f"{policy.name}, step {step}: {found.tolist()}")

"""Claims about hazards that are not known: both ends of mixtures' values, and laws of swarms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from _attack_bounds import random_paths
from _attack_model import Rates, enumerate_chain, shortened
from _attack_records import Check, Skip
from _attack_scenarios import Rng, draw, in_time, policies
from scipy.stats import binom

import casswarm as csw
from casswarm.guide.agent import initial_velocities

_SPEED = 1 + 1e-12
_PRIORS, _CLIMBS, _RUNS = 2000, 400, 2000


def mixtures(rng: Rng) -> Iterator[Check]:
    """Claim 11: no prior in Q is worse than the lower end, and no path better than the upper one.

    Priors are drawn at random, paths are drawn and climb with all the speed that the chain allows;
    rates and sets of priors are written here again.
    """
    scenario = in_time(rng, draw(rng, members=(1, 2), steps=(3, 14)))
    plain = {"target.other": None, "swarm.kind": None, "swarm.kinds": None, "success.arrivals": 1}
    scenario = _with_cases(rng, scenario.with_values(plain))
    ambiguity = _ambiguity(rng)
    mixed = csw.plan(scenario, ambiguity=ambiguity, time_limit=6.0)
    agents = [_Agent(case.scenario) for case in scenario.cases]
    survivals = np.array([[agent.survival(p.velocities) for agent in agents] for p in mixed.paths])
    mean = mixed.weights @ survivals
    prior = np.array([case.weight for case in scenario.cases])
    low, high = mixed.value
    worst = min(float(q @ mean) for q in _priors(rng, ambiguity, prior))
    yield Check("mixtures, lower end", low - worst, 1e-12 + 1e-9 * low, f"{ambiguity}: {worst!r}")
    against = mixed.worst_prior

    def mean_survival(velocities: np.ndarray) -> float:
        return float(against @ [agent.survival(velocities) for agent in agents])

    one = scenario.cases[0].scenario
    best = _climbed(rng, one, mean_survival)
    detail = f"{ambiguity}: a path of {best!r} against {against}, {high!r}"
    yield Check("mixtures, upper end", best - high, 1e-12, detail)
    yield Check("mixtures, order", low - high, 0.0, f"{low!r} > {high!r}")
    free = scenario.replace(guide={"acceleration_limited": False})
    exposed = csw.plan(free, ambiguity=ambiguity, objective="risk", time_limit=6.0)
    low, high = exposed.value
    risks = np.array([[agent.risk(p.velocities) for agent in agents] for p in exposed.paths])
    mean = exposed.weights @ risks
    worst = max(float(q @ mean) for q in _priors(rng, ambiguity, prior))
    yield Check("mixtures, risk above", worst - high, 1e-9 + 1e-9 * high, f"{ambiguity}: {worst!r}")
    against = exposed.worst_prior

    def mean_risk(velocities: np.ndarray) -> float:
        return -float(
            sum(q * agent.risk(velocities) for q, agent in zip(against, agents, strict=True) if q)
        )

    best = -_climbed(rng, one, mean_risk)
    detail = f"{ambiguity}: a path of risk {best!r} against {against}, {low!r}"
    yield Check("mixtures, risk below", low - best, 1e-12 + 1e-12 * low, detail)


def cases(rng: Rng) -> Iterator[Check]:
    """Claim 12: laws of swarms are those of the cases, sampled alike, and below the bounds.

    The law of every case is enumerated from the equations; the posterior is computed here again.
    """
    scenario = in_time(rng, draw(rng, members=(1, 3), steps=(1, 4)))
    plain = {"target.other": None, "swarm.kind": None, "swarm.kinds": None, "swarm.speed": "box"}
    scenario = _with_cases(rng, scenario.with_values(plain | {"time.substeps": 1}))
    scenario = scenario.replace(formation={"belief": str(rng.choice(["prior", "bayes"]))})
    guide = csw.plan(scenario.believed, certify=False)
    name = str(rng.choice([*policies(scenario, 2), "joint"]))
    policy = csw.make_policy(name, scenario, guide)
    exact = csw.evaluate(scenario, policy, 0.0, guide=guide, aggregation_tol=0.0)
    velocities = initial_velocities(scenario, guide)
    laws = exact.cases or ((1.0, exact),)
    for (_, law), case in zip(laws, scenario.cases, strict=True):
        if not policy.weighs_cases:
            truth = enumerate_chain(case.scenario, policy, velocities)
            error = float(np.abs(law.arrival - truth.arrival).max())
            yield Check("cases, law", error, 1e-9, f"{name}: {law.arrival} is not {truth.arrival}")
    mean = sum(weight * law.arrival for weight, law in laws)
    yield Check("cases, prior", float(np.abs(mean - exact.arrival).max()), 1e-12, name)
    study = csw.simulate(scenario, policy, _RUNS, int(rng.integers(1 << 30)), guide=guide)
    successes, success = int(study.summary["successes"][0]), exact.success.low
    few = binom.cdf(successes, _RUNS, min(1.0, success + 1e-9))
    many = binom.sf(successes - 1, _RUNS, max(0.0, success - 1e-9))
    detail = f"{name}, {scenario.formation.belief}: {successes} of {_RUNS}, probability {success}"
    yield Check("cases, sampling", -float(min(few, many)), -1e-7, detail)
    ambiguity = _ambiguity(rng)
    prior = np.array([case.weight for case in scenario.cases])
    bound = csw.success_bound(scenario, 20_000, max_work=1e5, ambiguity=ambiguity).value
    each = np.array([law.success.low for _, law in laws])
    worst = min(float(q @ each) for q in _priors(rng, ambiguity, prior))
    yield Check("cases, bound", worst - bound, 1e-12, f"{name}, {ambiguity}: {worst!r}, {bound!r}")


def _with_cases(rng: Rng, scenario: csw.Scenario) -> csw.Scenario:
    """The scenario with up to six cases, whose radars are elsewhere."""
    radars = np.array(scenario.hazard_table.radars, float).reshape(-1, 2)
    if not len(radars):
        raise Skip("no radars at rest")
    extent = float(np.abs(scenario.positions - np.array(scenario.target.center)).max())
    cases = []
    for _ in range(int(rng.integers(2, 7))):
        noise = 10 ** rng.uniform(-2, -0.3) * extent * rng.normal(size=radars.shape)
        shift = noise * (rng.random((len(radars), 1)) < 0.7)
        weight = 0.0 if rng.random() < 0.1 else float(10 ** rng.uniform(-1, 1))
        cases.append({"radars": (radars + shift).tolist(), "weight": weight})
    try:
        return scenario.with_values({"hazard.case": cases})
    except csw.ScenarioError:
        raise Skip("cases refused") from None


def _ambiguity(rng: Rng) -> Any:
    kind = str(rng.choice(["mean", "worst", "cvar", "tv"]))
    parameter = {"cvar": rng.uniform(0.05, 1.0), "tv": rng.uniform(0.0, 2.0)}.get(kind)
    return kind if parameter is None else (kind, float(parameter))


def _priors(rng: Rng, ambiguity: Any, prior: np.ndarray) -> Iterator[np.ndarray]:
    """Random priors in Q: on the ways from the given one to those of the simplex, as far as Q."""
    yield prior
    for _ in range(_PRIORS):
        other = rng.dirichlet(rng.choice([0.05, 1.0]) * np.ones(len(prior)))
        if ambiguity == "mean":
            return
        share = 1.0
        if ambiguity != "worst":
            kind, parameter = ambiguity
            change = other - prior
            if kind == "tv":
                share = min(1.0, parameter / max(float(np.abs(change).sum()), 1e-300))
            else:
                grows = change > 0
                room = (prior / parameter - prior)[grows] / change[grows]
                share = min(1.0, float(room.min(initial=1.0)))
        yield prior + share * (1 - 1e-12) * (other - prior)


class _Agent:
    """Survival of velocity sequences up to the first arrival, by the model's equations."""

    def __init__(self, scenario: csw.Scenario) -> None:
        self.scenario, self.rates = scenario, Rates.from_scenario(scenario)

    def survival(self, velocities: np.ndarray) -> float:
        """Survival of an agent from the guide's start; 0 if it does not arrive."""
        return float(np.exp(-self.risk(velocities)))

    def risk(self, velocities: np.ndarray) -> float:
        """Risk of an agent from the guide's start; infinite if it does not arrive."""
        scenario, target = self.scenario, self.scenario.target
        path = [np.array(scenario.guide_start)]
        for velocity in shortened(scenario, velocities, _SPEED)[: scenario.n_steps]:
            path.append(path[-1] + scenario.time.dt * velocity)
            if np.hypot(*(path[-1] - target.center)) <= target.radius:
                risks = self.rates.along(np.array(path))
                return float(scenario.time.dt * risks.sum())
        return np.inf


def _climbed(rng: Rng, scenario: csw.Scenario, value: Callable[[np.ndarray], float]) -> float:
    """The best value of random paths, and of climbs from the best of them."""
    paths = list(random_paths(rng, scenario))[:400]
    values = [value(path) for path in paths]
    path, best = paths[int(np.argmax(values))], max(values)
    limit = scenario.swarm.v_max * _SPEED
    scale = 0.1 * limit
    for _ in range(_CLIMBS):
        noise = scale * rng.normal(size=path.shape) * (rng.random(path.shape) < 0.4)
        trial = np.clip(path + noise, -limit, limit)
        if (found := value(trial)) > best:
            path, best = trial, found
        else:
            scale *= 0.99
    return best

"""Claims about bounds: of every path's risk, of every policy's success, and joint plans."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from _attack_acceleration import acceleration
from _attack_model import Rates, shortened, speed
from _attack_records import Check, Skip
from _attack_scenarios import Rng, as_led, draw, in_time, is_plain, late, limits_of, policies

import casswarm as csw
from casswarm.bounds import pair_bound
from casswarm.joint import PlanDistribution, PlanTree
from casswarm.policies.planned_paths import JointPolicy, ReplanningPolicy

_EPS = 2.0**-52
_SPEED = 1 + 1e-12  # the excess of speed that the chain allows
_PATHS, _CLIMBS = 3000, 40


def risk(rng: Rng) -> Iterator[Check]:
    """Claim 1: no path within the limits has less risk than a guide's certificate says."""
    scenario = in_time(rng, draw(rng, members=(1, 2), steps=(2, 16)))
    guide = csw.plan(scenario, gap=10 ** rng.uniform(-4, -1), time_limit=3.0)
    if guide.certificate is None:
        raise Skip("not certified")
    scenario, bound = as_led(scenario), guide.certificate.bound
    paths = _Paths(scenario)
    found: dict[str, list[np.ndarray]] = {
        "guide": [c.velocities for c in guide.candidates if np.isfinite(c.risk)],
        "random": list(random_paths(rng, scenario)),
        "Ipopt": list(_ipopt_paths(rng, scenario)),
    }
    value, plain = None, is_plain(scenario)
    if plain:
        value = csw.ValueFunction.from_scenario(scenario, 200_000)
        found["feedback"] = [_feedback_path(scenario, value)]
    known = [v for part in found.values() for v in part if np.isfinite(paths.risk(v))]
    if known:
        best = min(known, key=paths.risk)
        found["perturbed"] = list(_perturbed(rng, paths, best))
    for part, velocities in found.items():
        risks = [paths.risk(v) for v in velocities]
        finite = [r for r in risks if np.isfinite(r)]
        if finite:
            least = min(finite)
            limit = 64 * _EPS * scenario.n_steps * least
            yield Check(f"risk, {part}", bound - least, limit, f"bound {bound!r}, risk {least!r}")
    if value is not None:
        for velocities in known[:5] + known[-5:]:
            yield from _along(paths, value, velocities)
        yield _ordered(rng, scenario, value)
    yield from _guide_limits(scenario, guide)
    if not scenario.target.other:
        yield from acceleration(rng, scenario, guide)


def _guide_limits(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[Check]:
    """A guide arrives, within the limits of speed and, if they apply to it, of acceleration."""
    v_max, velocity = scenario.swarm.v_max, scenario.swarm.velocity
    yield Check("guide, speed", speed(scenario, guide.velocities) - 1, 1e-12)
    inside = scenario.target.contains(guide.positions)
    yield Check("guide, first arrival", float(inside.argmax() != guide.arrival or not inside.any()))
    if not scenario.guide.acceleration_limited:
        return
    changes = np.hypot(*np.diff(guide.velocities, axis=0).T)
    limit = np.sqrt(scenario.guide_a_max)
    yield Check("guide, acceleration", float(changes.max(initial=0.0) - limit) / v_max, 1e-12)
    if velocity != "guide":
        change = float(np.hypot(*(guide.velocities[0] - velocity)))
        excess = (change - np.sqrt(scenario.swarm.a_max)) / v_max
        yield Check("guide, first acceleration", excess, 1e-12)


def _ordered(rng: Rng, scenario: csw.Scenario, value: csw.ValueFunction) -> Check:
    """The value function's lower bounds are below its upper ones, anywhere."""
    start, center = np.array(scenario.guide_start), np.array(scenario.target.center)
    points = start + rng.uniform(-0.2, 1.2, size=(300, 1)) * (center - start)
    points += 0.3 * rng.normal(size=points.shape) * np.abs(center - start).max()
    low, high = value.bounds(int(rng.integers(scenario.n_steps)), points)
    return Check("value function, order", float((low > high * (1 + 1e-12)).sum()))


def _along(paths: _Paths, value: csw.ValueFunction, velocities: np.ndarray) -> Iterator[Check]:
    """The value function's lower bound at every state of a path."""
    positions, costs = paths.costs(velocities)
    for step in range(len(costs)):
        low = float(value.bounds(step, positions[step])[0])
        to_go = float(costs[step:].sum())
        limit = 64 * _EPS * len(costs) * to_go
        yield Check("risk to go", low - to_go, limit, f"step {step}: {low!r} > {to_go!r}")


def _arrived(scenario: csw.Scenario, position: np.ndarray) -> bool:
    """Whether a point is in one of the target zones."""
    discs = [scenario.target, *scenario.target.other]
    return any(np.hypot(*(position - disc.center)) <= disc.radius for disc in discs)


class _Paths:
    """Risk of velocity sequences up to the first arrival, by the model's equations."""

    def __init__(self, scenario: csw.Scenario) -> None:
        self.scenario, self.rates = scenario, Rates.from_scenario(scenario)
        self.limit = scenario.swarm.v_max * _SPEED

    def costs(self, velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (T+1, 2) and costs (T,) up to the first arrival; none without one."""
        scenario = self.scenario
        position = np.array(scenario.guide_start)
        positions = [position]
        for velocity in shortened(scenario, velocities, _SPEED)[: scenario.n_steps]:
            position = position + scenario.time.dt * velocity
            positions.append(position)
            if _arrived(scenario, position):
                path = np.array(positions)
                return path, scenario.time.dt * self.rates.along(path)
        return np.array(positions[:1]), np.zeros(0)

    def risk(self, velocities: np.ndarray) -> float:
        """Risk of a path; infinite without arrival."""
        costs = self.costs(velocities)[1]
        return float(costs.sum()) if len(costs) else np.inf


def random_paths(rng: Rng, scenario: csw.Scenario) -> Iterator[np.ndarray]:
    """Paths towards the target with noise, among them full speed in every component."""
    dt, v_max, steps = scenario.time.dt, scenario.swarm.v_max * _SPEED, scenario.n_steps
    center = np.array(rng.choice([disc.center for disc in scenario.target.discs]))
    noise = 10 ** rng.uniform(-2, 0.5, size=(_PATHS, 1)) * v_max
    x = np.tile(scenario.guide_start, (_PATHS, 1))
    velocities = np.empty((steps, _PATHS, 2))
    for step in range(steps):
        left = max(1, steps - step)
        toward = (center - x) / dt / rng.choice([1.0, left], size=(_PATHS, 1))
        v = toward + noise * rng.normal(size=(_PATHS, 2))
        reach = (left - 1) * dt * v_max  # stay where the target can still be reached
        x_next = np.clip(x + dt * np.clip(v, -v_max, v_max), center - reach, center + reach)
        velocities[step] = np.clip((x_next - x) / dt, -v_max, v_max)
        x = x + dt * velocities[step]
    yield from velocities.transpose(1, 0, 2)


def _ipopt_paths(rng: Rng, scenario: csw.Scenario) -> Iterator[np.ndarray]:
    """Local optima for some arrival steps from random starts, without acceleration limits."""
    dt, v_max, table = scenario.time.dt, scenario.swarm.v_max, scenario.hazard_table
    rates, target = Rates.from_scenario(scenario).after(1), rng.choice(scenario.target.discs)
    starts = list(random_paths(rng, scenario))
    for _ in range(2):
        steps = int(rng.integers(1, scenario.n_steps + 1)) if rng.random() < 0.5 else 0
        steps = steps or scenario.n_steps
        v = ca.SX.sym("v", 2, steps)
        x = np.array(scenario.guide_start) + dt * v_max * ca.cumsum(v, 1)
        strengths = rates.strengths
        cost: ca.SX = 0.0
        for radar, strength in zip(rates.radars, strengths, strict=True):
            offset = x - ca.repmat(ca.DM(radar), 1, steps)
            cost += ca.sum2(dt * strength / (ca.sum1(offset**2) + 1e-12 * (dt * v_max) ** 2))
        cost *= table.alpha_1 / (1 + table.alpha_2)  # zones do not count: a local optimum without
        miss = ca.sumsqr((x[:, -1] - ca.DM(target.center)) / target.radius)
        quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
        quiet |= {"ipopt.max_iter": 200, "error_on_fail": False}
        program = {"x": ca.vec(v), "f": 100 * cost, "g": miss}
        solver = ca.nlpsol("s", "ipopt", program, quiet)
        for _ in range(2):
            guess = starts[int(rng.integers(_PATHS))][-steps:] / v_max
            answer = solver(x0=guess.ravel(), lbx=-1, ubx=1, ubg=1 - 1e-7, lbg=-np.inf)
            velocities = np.array(answer["x"]).reshape(-1, 2) * v_max
            if np.isfinite(velocities).all():
                yield velocities


def _perturbed(rng: Rng, paths: _Paths, best: np.ndarray) -> Iterator[np.ndarray]:
    """A random descent from the best path, with all the speed that the chain allows."""
    risk, scale = paths.risk(best), 1e-2 * paths.limit
    for _ in range(_CLIMBS):
        noise = scale * rng.normal(size=best.shape) * (rng.random(best.shape) < 0.4)
        trial = np.clip(best * rng.choice([1.0, _SPEED]) + noise, -paths.limit, paths.limit)
        if (value := paths.risk(trial)) < risk:
            best, risk = trial, value
        else:
            scale *= 0.8
        yield trial


def _feedback_path(scenario: csw.Scenario, value: csw.ValueFunction) -> np.ndarray:
    x, velocities = np.array(scenario.guide_start), []
    for step in range(scenario.n_steps):
        velocities.append(value.velocities(step, x))
        x = x + scenario.time.dt * velocities[-1]
    return np.array(velocities)


class _Pushing:
    """A policy that asks for more than the limits: towards the target, all to one, or at random."""

    def __init__(self, scenario: csw.Scenario, kind: str, factor: float) -> None:
        self.scenario, self.kind, self.factor, self.name = scenario, kind, factor, kind

    def velocities(
        self, step: int, positions: np.ndarray, previous: np.ndarray, alive: np.ndarray
    ) -> np.ndarray:
        scenario = self.scenario
        toward = (np.array(scenario.target.center) - positions) / scenario.time.dt
        if self.kind == "together":
            count = np.maximum(1, alive.sum(axis=1))[:, None, None]
            mean = (positions * alive[..., None]).sum(axis=1, keepdims=True) / count
            toward = toward + (mean - positions) / scenario.time.dt
        if self.kind == "weaving":
            toward = toward + np.cos(step + 7.0 * positions + previous) * scenario.swarm.v_max
        return self.factor * toward


def success(rng: Rng) -> Iterator[Check]:
    """Claim 2: no policy succeeds more often than `success_bound`."""
    scenario = in_time(rng, draw(rng, steps=(1, 8)))
    if rng.random() < 0.5:  # the bound neglects this limit
        scenario = scenario.replace(swarm={"a_max": 10 * scenario.swarm.v_max**2})
    nodes, work = int(10 ** rng.uniform(3, 5.5)), 10 ** rng.uniform(4, 7)
    bound = csw.success_bound(scenario, nodes, max_work=work, accuracy=0.0)
    clocks = csw.success_bound(scenario, nodes, max_work=0)
    yield Check("success, never above clocks", bound.value - clocks.value, 0.0, f"{bound} {clocks}")
    yield Check("success, certified", float(not bound.certified))
    plain = is_plain(scenario)
    if scenario.n <= 6:
        best = _climbed(rng, scenario)
        detail = f"{best!r} > {bound.value!r} ({bound.method})"
        yield Check("success, climbed plans", best - bound.value, 1e-13, detail)
        if scenario.n == 2 and plain and scenario.success.arrivals == 1:
            yield from _pairs(scenario, best)
    if plain:
        value = csw.ValueFunction.from_scenario(scenario, 100_000, certified=False)
        best = csw.as_policy(lambda t, x, _v, _a: value.velocities(t, x), name="value function")
        yield _below(scenario, best, bound)
    for kind in ("toward", "together", "weaving"):
        pushing = _Pushing(scenario, kind, 10 ** rng.uniform(-0.3, 6))
        yield _below(scenario, csw.as_policy(pushing), bound)
    for name in rng.choice(policies(scenario), 2, replace=False):
        yield _below(scenario, str(name), bound)


def _pairs(scenario: csw.Scenario, best: float) -> Iterator[Check]:
    """The bound of two members, with what is known of their success and without."""
    for known in (0.0, 0.5 * best, best * (1 - 1e-12)):
        try:
            bound = pair_bound(scenario, known, max_nodes=100_000)
        except csw.PlanningError:  # it needs more nodes
            return
        yield Check("success, pairs", best - bound.value, 1e-13, f"{best!r} > {bound!r}")
        yield Check("success, pairs below 1", bound.value - 1.0)


def _climbed(rng: Rng, scenario: csw.Scenario) -> float:
    """Exact success of an open-loop plan after a random ascent from straight lines."""
    reach = scenario.time.dt * limits_of(scenario)[0]
    toward = np.array(rng.choice([d.center for d in scenario.target.discs])) - scenario.positions
    moves = np.repeat(np.clip(toward / scenario.n_steps, -reach, reach)[None], scenario.n_steps, 0)
    best, scale = -1.0, 0.3 * np.array(reach)
    for _ in range(3 * _CLIMBS):
        shape = (len(moves), 1 if rng.random() < 0.5 else scenario.n, 1)
        noise = scale * rng.normal(size=moves.shape) * (rng.random(shape) < 0.5) * (best >= 0)
        trial = shortened(scenario, (moves + noise) / scenario.time.dt) * scenario.time.dt
        path = np.concatenate([np.zeros((1, scenario.n, 2)), np.cumsum(trial, axis=0)])
        plan = PlanDistribution.from_positions(scenario, scenario.positions + path)
        if plan.success.low > best:
            moves, best = trial, plan.success.low
        else:
            scale *= 0.97
    return best


def _below(scenario: csw.Scenario, policy: object, bound: csw.SuccessBound) -> Check:
    distribution = csw.evaluate(scenario, policy, 1e-4, max_states=20_000)
    low = distribution.success.low
    part = "success, policies" if isinstance(policy, str) else "success, pushing"
    detail = f"{distribution.policy}: {low!r} > {bound.value!r}"
    return Check(part, low - bound.value, 1e-13, detail)


def joint(rng: Rng) -> Iterator[Check]:
    """Claim 8: a joint plan is what it states, within its limits and `success_bound`."""
    scenario = in_time(rng, draw(rng, members=(1, 3), steps=(2, 8)))
    plain = {"time.substeps": 1, "target.other": None, "swarm.speed": "box"}
    scenario = late(rng, scenario.with_values(plain))
    plan = csw.plan_swarm(scenario, seed=int(rng.integers(1000)), time_limit=10.0)
    assert plan.distribution is not None
    assert plan.success is not None
    assert plan.bound is not None
    exact = csw.evaluate(scenario, JointPolicy.from_plan(plan), 0.0).success
    difference = max(exact.low - plan.success.high, plan.success.low - exact.high)
    yield Check("joint, stated success", difference, 1e-12, f"{exact} is not {plan.success}")
    if rng.random() < 0.3:
        policy = ReplanningPolicy(PlanTree(scenario, plan), JointPolicy.from_plan(plan))
        again = csw.evaluate(scenario, policy, 0.0).success
        yield Check("joint, replanning", plan.success.low - again.high, 1e-12, f"{again}")
    failure, least = plan.distribution.failure, plan.bound.failure
    detail = f"failure {failure!r} below the bound {least!r}"
    yield Check("joint, bound", least - failure, 1e-12 * failure, detail)
    v_max, a_max = limits_of(scenario)
    yield Check("joint, speed", float((np.abs(plan.velocities) / v_max).max()) - 1, 1e-12)
    changes = np.diff(np.concatenate([plan.initial_velocities[None], plan.velocities]), axis=0)
    change = np.hypot(changes[..., 0], changes[..., 1])[..., None]
    excess = float(((change - np.sqrt(a_max)) / v_max).max())
    yield Check("joint, acceleration", excess, 1e-12)

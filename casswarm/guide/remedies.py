"""Why no path arrives: for each key alone, the least change with which one does.

Without hazards, the paths that arrive at a step and obey the limits of motion are a convex set, and
so is each with a limit times a factor: the least factor is a global minimum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias

import casadi as ca
import numpy as np

from ..nlp.program import Instances, Nlp
from ..problems.guide import GuideTask
from ..scenario import Scenario
from ..solvers import make_solver

_Limit: TypeAlias = Literal["a_max", "a_max_first", "both", "v_max", "radius"]

_TOLERANCE = 1e-6  # relative
_LONGEST = 4  # times the horizon
_MOST_STEPS = 400  # of a path in these programs


class Remedy(NamedTuple):
    """A change of a key with which, alone, a path obeys all limits and arrives.

    Parameters
    ----------
    key : str
    value : object
        What the scenario has.
    enough : object
        What is enough, rounded outwards to three digits, a horizon to five.
    """

    key: str
    value: object
    enough: object

    def __str__(self) -> str:
        return f"{self.key} = {_shown(self.enough)} (now {_shown(self.value)})"


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def remedies(scenario: Scenario) -> tuple[Remedy, ...] | None:
    """Changes of single keys that let a path of `scenario` arrive; none if one does already.

    A path may arrive after all steps, or a half, a quarter or three quarters of them. None means
    that no single change is enough, or that there is no answer: for several target zones, members
    that differ, and long horizons.
    """
    steps = scenario.n_steps
    if scenario.target.other or scenario.swarm.kind is not None or steps > _MOST_STEPS:
        return None
    scenario = scenario.for_guide
    initial = scenario.swarm.initial_velocity
    task = GuideTask.from_scenario(scenario, scenario.guide_start, initial)
    quarters = (4,) if scenario.guide.arrival == "horizon" else (1, 2, 3, 4)
    tried = {-(-steps * number // 4) for number in quarters}
    radius = _least(task, tried, "radius")
    if radius <= 1 + _TOLERANCE:
        return ()
    return tuple(_found(scenario, task, tried, radius * task.radius)) or None


def _found(scenario: Scenario, task: GuideTask, tried: set[int], radius: float) -> Iterator[Remedy]:
    """Remedies, of which `radius` is that of a zone in which a path arrives."""
    swarm, limits = scenario.swarm, scenario.guide
    yield from _raised("swarm.v_max", swarm.v_max, _least(task, tried, "v_max"))
    own = limits.acceleration_limited and limits.a_max is not None
    if own:
        yield from _raised("guide.a_max", limits.a_max, _least(task, tried, "a_max"))
    if limits.acceleration_limited and not (own and swarm.velocity == "guide"):
        of: _Limit = "a_max_first" if own else "both"
        yield from _raised("swarm.a_max", swarm.a_max, _least(task, tried, of))
    if swarm.velocity != "guide":
        free = replace(task, a_max_first=math.inf)
        if _least(free, tried, "radius") <= 1 + _TOLERANCE:
            yield Remedy("swarm.velocity", list(swarm.velocity), "guide")
    if (enough := _horizon(task, scenario.n_steps)) is not None:
        horizon = _up(enough * scenario.time.dt, 5)  # closer than a step: no other number of them
        yield Remedy("time.t_f", scenario.time.t_f, horizon)
    zone, margin = scenario.target.radius, scenario.arrival_margin
    if (larger := _up(_zone(scenario, radius))) < np.hypot(*(task.center - task.start)):
        yield Remedy("target.radius", zone, larger)  # which does not hold the start
    if radius < zone * (1 - _TOLERANCE):
        yield Remedy("guide.margin", margin, -_up(radius - zone))


def _raised(key: str, value: float | None, factor: float) -> Iterator[Remedy]:
    if value is not None and math.isfinite(factor):
        yield Remedy(key, value, _up(value * factor))


def _zone(scenario: Scenario, radius: float) -> float:
    """Radius of a target zone of which the guide must reach the part of another radius."""
    if scenario.guide.margin is not None:
        return radius + scenario.guide.margin
    if scenario.n == 1:
        return radius * (1 + 2 * scenario.arrival_margin / scenario.target.radius)
    return min(radius + math.sqrt(scenario.formation.rho), 2 * radius)


def _up(value: float, digits: int = 3) -> float:
    """Round upwards to so many digits."""
    if not math.isfinite(value) or value == 0:
        return value
    unit = 10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits)
    outwards = value + abs(value) * _TOLERANCE
    return float(f"{math.ceil(outwards / unit) * unit:.12g}")


def _horizon(task: GuideTask, steps: int) -> int | None:
    """Number of steps, above the given one, after which a path arrives."""
    enough, short = min(_LONGEST * steps, _MOST_STEPS), steps
    if _least(task, {enough}, "radius") > 1 + _TOLERANCE:
        return None
    while enough - short > 1:
        middle = (enough + short) // 2
        arrives = _least(task, {middle}, "radius") <= 1 + _TOLERANCE
        enough, short = (middle, short) if arrives else (enough, middle)
    return enough


def _least(task: GuideTask, tried: set[int], limit: _Limit) -> float:
    """Least factor of a limit with which a path arrives after one of the numbers of steps."""
    return min(_factor(task, steps, limit) for steps in tried)


def _factor(task: GuideTask, steps: int, limit: _Limit) -> float:
    """Least factor of a limit with which a path arrives after so many steps; infinite if none is.

    Velocities are in units of v_max.
    """
    u, q = ca.SX.sym("u", 2, steps), ca.SX.sym("q")
    x, rows = ca.vertcat(ca.vec(u), q), ca.vertcat(*_rows(task, u, q, limit))
    nlp = Nlp.from_expressions("limits", x, ca.SX(0, 1), q, rows)
    ahead = (task.center - task.start) / (steps * task.dt * task.v_max)
    count, free = nlp.sizes[2], np.full((1, 2 * steps + 1), np.inf)
    instance = Instances(
        x0=np.append(np.tile(np.clip(ahead, -1, 1), steps), 2.0)[None],
        p=np.empty((1, 0)),
        lbx=np.append(-free[:, 1:], [[0.0]], axis=1),
        ubx=free,
        lbg=np.full((1, count), -np.inf),
        ubg=np.zeros((1, count)),
    )
    (solution,) = make_solver("ipopt").solve(nlp, instance)
    if not solution.status.success:
        return math.inf
    squared = limit == "radius" or (limit == "v_max" and task.disc)
    return math.sqrt(solution.objective) if squared else float(solution.objective)


def _rows(task: GuideTask, u: ca.SX, q: ca.SX, limit: _Limit) -> Iterator[ca.SX]:
    """Rows that are at most 0: of speeds, of their changes, and of the arrival.

    Speeds and lengths are limited by their squares, but for speeds along the axes.
    """
    speed = q if limit == "v_max" else 1
    yield ca.sum1(u**2).T - speed if task.disc else ca.vertcat(ca.vec(u), -ca.vec(u)) - speed
    before = ca.horzcat(ca.DM(task.initial_velocity / task.v_max), u[:, :-1])
    changes = ca.sum1((u - before) ** 2).T * task.v_max**2
    first, others = task.a_max_first, task.a_max
    if math.isfinite(first):
        yield changes[0] / first - (q if limit in ("a_max_first", "both") else 1)
    if math.isfinite(others):
        yield changes[1:] / others - (q if limit in ("a_max", "both") else 1)
    ahead = ca.DM((task.center - task.start) / (task.dt * task.v_max))
    far = (task.radius / (task.dt * task.v_max)) ** 2
    yield ca.sumsqr(ca.sum2(u) - ahead) / far - (q if limit == "radius" else 1)

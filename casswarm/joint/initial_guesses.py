"""Initial guesses of joint plans: the best of some families, and changes of the best plan."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..guide.agent import plan_from
from ..guide.guide import Guide
from ..guide.multistart import GRID_PATH, STRAIGHT
from ..motion.kinematics import integrate, interpolated, remaining_distance, resample
from ..problems.joint import JointTask
from ..problems.member_sets import subsets
from ..typing import FloatArray, IntArray
from .plan_distribution import MAX_EXACT, prescribed_costs

if TYPE_CHECKING:
    from ..scenario import Scenario


MAX_STATES = 2e7
"""States of plans, 3^n for each step, that are evaluated for a screening."""

REPETITION = 0.5
"""Log-odds by which a guess counts as worse for every better one of its family."""


@dataclass(frozen=True, eq=False)
class InitialGuess:
    """An initial plan.

    Parameters
    ----------
    name : str
    arrivals : (n,) int
        Arrival steps to prescribe, 0 for a member that cannot arrive.
    velocities : (T, n, 2)
    """

    name: str
    arrivals: IntArray
    velocities: FloatArray


@dataclass(frozen=True, eq=False)
class Family:
    """Alternatives of one initial guess, of which the search takes the best."""

    name: str
    arrivals: IntArray  # (B, n)
    goals: FloatArray  # (N, B, n, 2), points to track, one per step

    def guesses(self, arrivals: IntArray, velocities: FloatArray) -> list[InitialGuess]:
        """Guesses of arrival steps (b, n) and velocities (N, b, n, 2), cut at the last arrival."""
        lasts = self.arrivals.max(axis=1)[: len(arrivals)]
        return [
            InitialGuess(self.name, arrivals[k], velocities[:last, k])
            for k, last in enumerate(lasts)
        ]


def screened(
    scenario: Scenario, task: JointTask, objective: str, families: list[Family], count: int
) -> list[InitialGuess]:
    """The `count` best guesses before they are optimised, in order.

    They are judged by the log-odds of their exact cost, plus `REPETITION` for every better guess of
    their family. Swarms that are too large for an exact cost take the first of each family.
    """
    n = scenario.n
    limit = int(MAX_STATES / (task.steps * 3.0**n)) if n <= MAX_EXACT else 0
    size = max(1, limit // len(families))
    guesses: list[InitialGuess] = []
    scores: list[float] = []
    for family in families:
        arrivals = delayed(task, family.arrivals[:size])
        velocities = track(task, family.goals[:, :size])
        costs = np.full(len(arrivals), 0.5)
        if limit:
            positions = tracked_positions(task, velocities).swapaxes(0, 1)
            costs = prescribed_costs(scenario, objective, positions, arrivals)
        with np.errstate(divide="ignore"):
            odds = np.log(costs) - np.log1p(-costs)
        scores += (odds + REPETITION * odds.argsort(kind="stable").argsort()).tolist()
        guesses += family.guesses(arrivals, velocities)
    return [guesses[k] for k in np.argsort(scores, kind="stable")[:count].tolist()]


def delayed(task: JointTask, arrivals: IntArray) -> IntArray:
    """Arrival steps (B, n), delayed to the first that v_max allows; 0 if it allows none.

    If several members must be in the target together, all arrive with the last.
    """
    reach = np.arange(1, task.steps + 1)[:, None, None] * task.motion.dt * task.motion.bounds[:, :1]
    distance = remaining_distance(task.start, task.center, reach)  # (N, n)
    feasible = distance <= task.radius - task.margin
    earliest = np.where(feasible.any(axis=0), feasible.argmax(axis=0) + 1, 0)
    steps = np.where(earliest > 0, np.maximum(arrivals, earliest), 0)
    return steps if task.needed == 1 else np.where(steps > 0, steps.max(axis=-1, keepdims=True), 0)


def track(task: JointTask, goals: FloatArray) -> FloatArray:
    """Velocities (T, ..., n, 2) that track goals of that shape, within v_max and a_max."""
    motion = task.motion
    shape = goals.shape[1:]
    positions = np.broadcast_to(task.start, shape)
    previous_velocities = np.broadcast_to(task.initial_velocities, shape)
    velocities = np.empty_like(goals)
    for step, goal in enumerate(goals):
        velocities[step] = motion.toward(positions, previous_velocities, goal)
        positions = positions + motion.dt * velocities[step]
        previous_velocities = velocities[step]
    return velocities


def tracked_positions(task: JointTask, velocities: FloatArray) -> FloatArray:
    """Positions (N+1, B, n, 2) of velocities (N, B, n, 2)."""
    start = np.broadcast_to(task.start, velocities.shape[1:])
    return integrate(start, velocities, task.motion.dt)


def padded(path: FloatArray, steps: int) -> FloatArray:
    """A path (T+1, ..., 2) that stays at its end until a step: (steps+1, ..., 2)."""
    return path[np.minimum(np.arange(steps + 1), len(path) - 1)]


def turns(angles: FloatArray) -> FloatArray:
    """Matrices (m, 2, 2) of turns by angles (m,)."""
    rows = [[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]
    return np.array(rows).transpose(2, 0, 1)


MAX_CLASSES = 3
"""Homotopy classes, in order of risk, along which formations start."""

MAX_ARRIVALS = 2
"""Arrival steps of each of these classes, in order of risk."""

MAX_DIVIDED = 6
"""Maximum number of members of swarms that are divided in all ways."""

MAX_CUTS = 60
"""Divisions of larger swarms, of which few are optimised."""

_SPACINGS = np.concatenate([[0.0], np.geomspace(0.02, 2.0, 41)])
"""Candidate distances of neighbours, in units of the target's radius."""

_DIRECTIONS = 6  # of lattices, over half a turn
_WAVES = 3  # sines in a random path
_COMMON, _OWN = 0.3, (0.02, 0.1, 0.3)  # their amplitudes, in distances from start to target


def class_paths(scenario: Scenario, guide: Guide) -> dict[str, list[FloatArray]]:
    """Paths (T+1, 2) of the best homotopy classes with their best arrival steps, best first."""
    start, dt = guide.positions[0], scenario.time.dt
    ranked = sorted((c for c in guide.candidates if np.isfinite(c.risk)), key=lambda c: c.risk)
    paths: dict[str, dict[int, FloatArray]] = {}
    for candidate in ranked:
        alternatives = paths.setdefault(candidate.homotopy or GRID_PATH, {})
        if len(alternatives) < MAX_ARRIVALS:
            path = integrate(start, candidate.velocities, dt)
            alternatives.setdefault(len(candidate.velocities), path)
    if not paths:  # no single agent arrives: straight to the target in all the time available
        line = np.stack([start, np.array(scenario.target.center)])
        return {STRAIGHT: [integrate(start, resample(line, scenario.n_steps, dt), dt)]}
    best = list(paths.items())[:MAX_CLASSES]
    return {name: list(alternatives.values()) for name, alternatives in best}


def families(
    scenario: Scenario,
    task: JointTask,
    paths: dict[str, list[FloatArray]],
    formations: bool,
    own: bool,
) -> Iterator[Family]:
    """Families along paths (T+1, 2) by homotopy class, best first: formations, own paths."""
    if formations:
        for name, alternatives in paths.items():
            title = name if name == STRAIGHT else f"formation {name}"
            for path in alternatives:
                yield _formations(scenario, task, title, path)
        if scenario.n > 1:
            for one, other in itertools.combinations(paths, 2):
                pair = paths[one][0], paths[other][0]
                yield _divided(scenario, task, f"divided {one}, {other}", *pair)
    if own:
        yield _own_paths(scenario, task, paths)


def waves(task: JointTask, count: int, rng: np.random.Generator) -> Family:
    """Straight lines to the target with random waves of all members and of each.

    Arrival steps are those that the speed limit allows all members, in turn.
    """
    n, steps = len(task.start), task.steps
    to_center = task.center - task.start
    length = np.hypot(*to_center.mean(axis=0))
    fastest = int(np.ceil((abs(to_center) / (task.motion.bounds[:, :1] * task.motion.dt)).max()))
    last = np.resize(np.arange(min(steps, fastest), steps + 1), count)
    share = np.minimum(np.arange(1, steps + 1)[:, None] / last, 1.0)[..., None]
    orders = np.arange(1, _WAVES + 1)
    common = rng.normal(size=(count, _WAVES, 1, 2)) * _COMMON
    own = rng.normal(size=(count, _WAVES, n, 2)) * rng.choice(_OWN, (count, 1, 1, 1))
    sines = np.sin(np.pi * share * orders) / orders
    bumps = np.einsum("tbw,bwni->tbni", sines, length * (common + own))
    goals = task.start + share[..., None] * to_center + bumps
    return Family("waves", np.repeat(last[:, None], n, axis=1), goals)


def _formations(scenario: Scenario, task: JointTask, name: str, path: FloatArray) -> Family:
    """All members around a path, in lattices of several directions, or as they start."""
    offsets = np.stack(_lattices(scenario, path, scenario.positions, task.min_distance))
    if scenario.n > 1:
        offsets = np.concatenate([offsets, [scenario.positions - scenario.guide_start]])
    goals = padded(path, task.steps)[1:, None, None] + offsets
    return Family(name, np.full((len(offsets), scenario.n), len(path) - 1), goals)


def _divided(
    scenario: Scenario, task: JointTask, name: str, one: FloatArray, other: FloatArray
) -> Family:
    """Members divided between two paths, each part in a formation of its own."""
    goals, arrivals = [], []
    both = [padded(path, task.steps)[1:] for path in (one, other)]
    for assigned in _divisions(scenario, both):
        goal = np.stack([both[k] for k in assigned], axis=1)
        for k, path in enumerate((one, other)):
            part = assigned == k
            lattices = _lattices(scenario, path, scenario.positions[part], task.min_distance)
            goal[:, part] += lattices[0]
        goals.append(goal)
        arrivals.append(np.array([len(one) - 1, len(other) - 1])[assigned])
    return Family(name, np.array(arrivals), np.stack(goals, axis=1))


def _divisions(scenario: Scenario, paths: list[FloatArray]) -> list[IntArray]:
    """Path, 0 or 1, of every member (n,): all divisions of few members, cuts of many.

    The members on the side of a path take it.
    """
    n = scenario.n
    if n <= MAX_DIVIDED:
        return [subset.astype(int) for subset in subsets(n).members[1:-1]]
    middle = len(paths[0]) // 2
    order = np.argsort(scenario.positions @ (paths[1] - paths[0])[middle], kind="stable")
    rank = np.argsort(order)
    cuts = sorted(range(1, n), key=lambda cut: abs(2 * cut - n))[:MAX_CUTS]
    return [(rank >= cut).astype(int) for cut in cuts]


def _own_paths(scenario: Scenario, task: JointTask, paths: dict[str, list[FloatArray]]) -> Family:
    """Every member along the path that is safest for it alone."""
    available = [path for alternatives in paths.values() for path in alternatives]
    goals = np.stack([padded(path, task.steps)[1:] for path in available], axis=1)  # (N, m, 2)
    tiled = np.broadcast_to(goals[:, :, None], (*goals.shape[:2], scenario.n, 2))
    positions = tracked_positions(task, track(task, tiled))  # (N+1, m, n, 2)
    last = np.array([len(path) - 1 for path in available])
    under_way = np.arange(1, task.steps + 1)[:, None] <= last
    rates = scenario.hazard.rates_along(positions[1:]) * under_way[..., None]
    choice = rates.sum(axis=0).argmin(axis=0)
    return Family("own paths", last[choice][None], goals[:, None, choice])


def _lattices(
    scenario: Scenario, path: FloatArray, positions: FloatArray, min_distance: float
) -> list[FloatArray]:
    """Offsets (m, 2) of members at `positions` (m, 2) from a path's point, in several directions.

    They form a triangular lattice or, from four members on, a regular polygon, with the spacing of
    least total rate where the path is most dangerous. Members are assigned to its points by least
    total squared distance.
    """
    from scipy.optimize import linear_sum_assignment  # slow to import

    count = len(positions)
    if count == 1:
        return [np.zeros((1, 2))]
    shapes = [_lattice(count), _polygon(count)] if count > 3 else [_lattice(count)]
    step = 1 + int(scenario.hazard.rates_along(path[1:]).argmax())
    worst, hazard = path[step], scenario.for_guide.hazard.after(step)
    spacings = np.maximum(_SPACINGS * scenario.target.radius, 1.05 * min_distance)
    centered = positions - positions.mean(axis=0)
    assigned = []
    for shape in shapes:
        totals = hazard.rates(worst + spacings[:, None, None] * shape).sum(axis=1)
        offsets = spacings[int(totals.argmin())] * shape
        for turn in turns(np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS):
            turned = offsets @ turn.T
            costs = ((centered[:, None] - turned[None]) ** 2).sum(axis=-1)
            assigned.append(turned[linear_sum_assignment(costs)[1]])
    rounded = np.round(assigned, 9)  # lattices of some sizes come back to themselves
    return [assigned[k] for k in sorted(np.unique(rounded, axis=0, return_index=True)[1])]


def _polygon(n: int) -> FloatArray:
    """The corners (n, 2) of a regular polygon with sides of length 1."""
    angles = 2 * np.pi * np.arange(n) / n
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray(corners / (2 * np.sin(np.pi / n)))


def _lattice(n: int) -> FloatArray:
    """The n points of a triangular lattice of spacing 1 that are nearest to their centroid."""
    size = int(np.ceil(np.sqrt(n))) + 2
    i, j = np.meshgrid(*[np.arange(-size, size + 1)] * 2, indexing="ij")
    points = np.stack([i + 0.5 * j, np.sqrt(0.75) * j], axis=-1).reshape(-1, 2)
    centered = points - (np.array([0.5, np.sqrt(0.75) / 3]) if n in (2, 3, 6) else 0.0)
    chosen = centered[np.argsort(np.round((centered**2).sum(axis=1), 9), kind="stable")[:n]]
    return np.asarray(chosen - chosen.mean(axis=0))


MAX_PERMUTED = 5
"""Maximum number of members of swarms whose roles are exchanged in all ways."""

_SHIFTS = (-2, -1, 1, 2)  # of the last arrival step
_TURNS = 12  # of a formation
_CHANGED = ", changed"


def changes(
    task: JointTask, plan: InitialGuess, paths: Mapping[str, Sequence[FloatArray]]
) -> Iterator[Family]:
    """Families of plans that differ from a plan in one respect.

    `paths` (T+1, 2) are those of each homotopy class, best first.
    """
    name = f"{plan.name.removesuffix(_CHANGED)}{_CHANGED}"
    path = integrate(task.start, plan.velocities, task.motion.dt)
    yield _exchanged(name, task, plan, path)
    yield _turned(name, task, plan, path)
    yield from _stretched(name, task, plan, path)
    if paths:
        yield _rerouted(name, task, plan, path, [each[0] for each in paths.values()])


def _exchanged(name: str, task: JointTask, plan: InitialGuess, path: FloatArray) -> Family:
    """Members take each other's trajectories: in all ways if there are few, else up to three."""
    n = path.shape[1]
    orders = itertools.permutations(range(n)) if n <= MAX_PERMUTED else _cycles(n)
    others = np.array([order for order in orders if order != tuple(range(n))])
    return Family(name, plan.arrivals[others], padded(path, task.steps)[1:, others])


def _cycles(n: int) -> Iterator[tuple[int, ...]]:
    """Permutations of n members that move two or three of them."""
    for size in (2, 3):
        for moved in itertools.combinations(range(n), size):
            for shift in range(1, size):
                order = list(range(n))
                for k, member in enumerate(moved):
                    order[member] = moved[(k + shift) % size]
                yield tuple(order)


def _turned(name: str, task: JointTask, plan: InitialGuess, path: FloatArray) -> Family:
    """The formation turned and reflected about its centroid, at all steps by the same."""
    turned = turns(2 * np.pi * np.arange(_TURNS) / _TURNS)
    matrices = np.concatenate([turned[1:], turned @ np.diag([1.0, -1.0])])
    whole = padded(path, task.steps)[1:, None]  # (N, 1, n, 2)
    center = whole.mean(axis=2, keepdims=True)
    goals = center + (whole - center) @ matrices
    return Family(name, np.tile(plan.arrivals, (len(matrices), 1)), goals)


def _stretched(
    name: str, task: JointTask, plan: InitialGuess, path: FloatArray
) -> Iterator[Family]:
    """All members along their paths in more or less time."""
    last = len(path) - 1
    for steps in (last + shift for shift in _SHIFTS):
        if not 0 < steps <= task.steps:
            continue
        stretched = interpolated(path, np.linspace(0, last, steps + 1))
        arrivals = np.ceil(plan.arrivals * (steps / last) - 1e-9).astype(int)
        yield Family(name, arrivals[None], padded(stretched, task.steps)[1:, None])


def _rerouted(
    name: str, task: JointTask, plan: InitialGuess, path: FloatArray, others: list[FloatArray]
) -> Family:
    """Family of plans in which one member follows another path of a single agent."""
    n, whole = path.shape[1], padded(path, task.steps)[1:]
    cases = list(itertools.product(range(n), others))
    arrivals = np.tile(plan.arrivals, (len(cases), 1))
    goals = np.repeat(whole[:, None], len(cases), axis=1)
    for case, (member, other) in enumerate(cases):
        arrivals[case, member] = len(other) - 1
        goals[:, case, member] = padded(other, task.steps)[1:]
    return Family(name, arrivals, goals)


INITIAL_GUESSES = ("formations", "own", "waves", "perturbed")
"""Kinds of initial guesses: formations, members' own paths, random ones, and changes of the best
plan."""

_AMPLITUDE = 0.1  # of perturbations, in units of v_max
_ALTERNATIVE_WAVES = 4
_PERTURBED = ", perturbed"


@dataclass(frozen=True, eq=False)
class Guesses:
    """The initial guesses of one joint plan."""

    scenario: Scenario
    task: JointTask
    objective: str

    @cached_property
    def paths(self) -> dict[str, list[FloatArray]]:
        """Paths (T+1, 2) of a single agent by homotopy class; see `class_paths`."""
        scenario = self.scenario.believed
        values = {
            "guide.arrival": "any",
            "guide.acceleration_limited": True,
            "guide.margin": 1e-3 * scenario.target.radius,  # the joint plan decides on the offsets
        }
        guide = plan_from(
            scenario.with_values(values),
            scenario.guide_start,
            search="global",
            initial_velocity=self.task.initial_velocities[scenario.swarm.central_member],
        )
        return class_paths(scenario, guide)

    def first(self, kinds: Sequence[str], count: int) -> list[InitialGuess]:
        """The best formations and own paths, where they are among the kinds.

        Formations where members' own paths do not apply.
        """
        own = "own" in kinds and 1 < self.scenario.n <= MAX_EXACT
        formations = "formations" in kinds or not (own or "waves" in kinds)
        if not own and not formations:
            return []
        found = families(self.scenario.believed, self.task, self.paths, formations, own)
        return screened(self.scenario, self.task, self.objective, list(found), count)

    def waves(self, count: int, rng: np.random.Generator) -> list[InitialGuess]:
        """Random guesses; their cost before they are optimised tells too little to choose."""
        family = waves(self.task, count, rng)
        return family.guesses(delayed(self.task, family.arrivals), track(self.task, family.goals))

    def changed(self, plan: InitialGuess, count: int, rerouted: bool = True) -> list[InitialGuess]:
        """The best changes of a plan, before they are optimised; none without an exact cost.

        `rerouted` tells whether members take other paths, which needs the guide's.
        """
        if not 1 < self.scenario.n <= MAX_EXACT:
            return []
        found = changes(self.task, plan, self.paths if rerouted else {})
        return screened(self.scenario, self.task, self.objective, list(found), count)

    def perturbed(self, plan: InitialGuess, rng: np.random.Generator) -> InitialGuess:
        """The plan with random low-frequency waves added to every member's velocity."""
        steps, n, _ = plan.velocities.shape
        phases = np.linspace(0.0, np.pi, steps)[:, None] * np.arange(_ALTERNATIVE_WAVES)
        amplitudes = rng.normal(size=(_ALTERNATIVE_WAVES, n, 2)) / np.sqrt(_ALTERNATIVE_WAVES)
        waves = np.tensordot(np.cos(phases), amplitudes, axes=1)
        return replace(
            plan,
            name=f"{plan.name.removesuffix(_PERTURBED)}{_PERTURBED}",
            velocities=plan.velocities + _AMPLITUDE * self.task.motion.v_max * waves,
        )

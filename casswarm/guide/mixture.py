"""Guides for a hazard that is not known: mixtures of paths that are best against a set of priors.

A single agent observes only that it lives, so a policy is a path, or a distribution over paths that
is drawn before the start. Against all priors in Q, the best mixture is the solution of a matrix
game over paths, which are added one by one: the best path against the worst prior so far, by the
guide's program with the objective of several cases. ``docs/mixtures.md`` has the theory.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from typing_extensions import override

from .._util.display import Displayed
from .._util.numbers import rounded_up
from .._util.text import counted
from ..bounds import MixtureBound, mixture_bound
from ..bounds.belief_bound import DIVISIONS, MAX_CASES, BeliefProgram, best_belief_path, simplex
from ..bounds.risk_bound import GAP, arrival_multiplier
from ..errors import PlanningError
from ..grid.nodes import Grid, Relaxation
from ..motion.kinematics import integrate
from ..nlp.program import Instances, Nlp
from ..problems.guide import GuideTask, guide_instance, guide_nlp
from ..scenario import Scenario
from ..scenario.ambiguity import SUPPORT, AmbiguityLike, Mixture, of_game
from ..scenario.ambiguity import Ambiguity as Ambiguity
from ..scenario.variations import require_default
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Interval, Progress
from .agent import plan_from
from .certificate import TIME_LIMIT
from .guide import Candidate, Guide
from .multistart import GridPath, Multistart

_LEAST = 1e-6  # prior of a case in the program, whose logarithm is taken
_ROUNDS = 40  # of adding paths
_ROUNDS_NEAR = 2  # near another mixture
_ENOUGH = 1e-6  # relative gain of a path from which it is added
_SEARCHED = 1_500_000  # values of the dynamic program that finds paths
_MOST_RISK = 100.0  # of a guess


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MixedGuide(Mixture, Displayed):
    """A distribution over guides for a hazard that is not known, and what it is worth.

    Parameters
    ----------
    paths : tuple of Guide
        Guides of positive weight, the likeliest first. Their rates are the prior means of those of
        the cases.
    pure : Guide
        The best single guide that is known.
    guides : tuple of Guide
        The guide of every case, as if it were known.
    bound : MixtureBound, optional
        Details of the proof, up to four cases; with more, `note` has how they are divided.
    objective : {"survival", "risk"}
        With ``"risk"``, `value`, `pure_value` and `known_value` are the largest mean risks over Q:
        that of this mixture is the upper end of `value`, and the lower one is proven.
    weights, survivals, prior, ambiguity, value, worst_prior, pure_value, known, note
        As of `casswarm.scenario.ambiguity.Mixture`.
    """

    paths: tuple[Guide, ...]
    pure: Guide
    guides: tuple[Guide, ...]
    bound: MixtureBound | None = None
    objective: Literal["survival", "risk"] = "survival"

    @property
    @override
    def known_value(self) -> float:
        if self.objective == "survival":
            return super().known_value
        return -self.ambiguity.least(np.log(self.known), self.prior)

    @property
    @override
    def measure(self) -> str:
        return self.objective

    @property
    @override
    def routes(self) -> list[FloatArray]:
        return [path.positions[:, None] for path in self.paths]

    @classmethod
    def of_guide(
        cls, guide: Guide, ambiguity: Ambiguity, objective: Literal["survival", "risk"] = "survival"
    ) -> MixedGuide:
        """The mixture of one guide for a hazard that is known."""
        survival = guide.survival
        high = 1.0 if guide.survival_bound is None else max(guide.survival_bound, survival)
        _, fields = of_game(ambiguity, np.array([[survival]]), np.ones(1))
        fields |= {"value": Interval(survival, high), "known": np.array([survival])}
        if objective == "risk":
            low = min(guide.risk_bound or 0.0, guide.risk)
            fields |= {"value": Interval(low, guide.risk), "pure_value": guide.risk}
        note = "the hazard has one case"
        same: dict[str, Any] = {"paths": (guide,), "pure": guide, "guides": (guide,)}
        return cls(objective=objective, note=note, **same, **fields)

    def __str__(self) -> str:
        paths = self._chosen("arrives")
        guides = counted(len(self.paths), "guide")
        if self.objective == "survival":
            return self._text(guides, paths)
        low, high = self.value
        proven = f"no mixture can be below {-rounded_up(-low):.4f}" if low > 0 else "not certified"
        risks = ", ".join(f"{risk:.4f}" for risk in self.weights @ -np.log(self.survivals))
        priors = ", ".join(f"{q:.3f}" for q in self.worst_prior)
        return (
            f"mixture of {guides} for {self.ambiguity}: risk {high:.4f} ({proven})\n"
            f"best single guide found {self.pure_value:.4f}, with the case known "
            f"{self.known_value:.4f}\n"
            f"weights: {paths}\nrisk by case: {risks}; worst prior: {priors}"
        )


@dataclass(frozen=True)
class CasesMultistart(Multistart):
    """Solves of the guide problem of several cases with a prior; risks are -log mean survival.

    Parameters
    ----------
    cases : tuple of K Scenario
    prior : (K,)
        Positive.
    """

    cases: tuple[Scenario, ...] = ()
    prior: FloatArray = field(default_factory=lambda: np.ones(1))

    @property
    @override
    def program(self) -> Nlp:
        hazards, one = tuple(case.by_parts.hazard for case in self.cases), self.scenario
        return guide_nlp(hazards, one.n_steps, one.time.substeps, self.task.disc)

    @override
    def instance(self, nlp: Nlp, arrival: int, guess: FloatArray, scale: float) -> Instances:
        positions = integrate(self.task.start, self.task.limited(guess), self.task.dt)
        with np.errstate(divide="ignore"):
            risks = np.minimum(-np.log(survivals_of(self.cases, positions)), _MOST_RISK)
        return guide_instance(nlp, self.task, arrival, guess, scale, (self.prior, risks))

    @override
    def risk(self, positions: FloatArray) -> float:
        with np.errstate(divide="ignore"):
            return float(-np.log(self.prior @ survivals_of(self.cases, positions)))

    @override
    def _scale(self, velocities: FloatArray) -> float:
        return 1.0  # risks are exponents


def survivals_of(cases: Sequence[Scenario], positions: FloatArray) -> FloatArray:
    """Survival (K,) of an agent along a path (T+1, 2) in every case."""
    risks = [case.time.dt * case.rates_along(positions).sum() for case in cases]
    return np.asarray(np.exp(-np.array(risks)))


@dataclass
class _Game:
    """The matrix game of paths against priors, while paths are added."""

    cases: tuple[Scenario, ...]
    prior: FloatArray
    ambiguity: Ambiguity
    task: GuideTask
    solver: Solver
    deadline: float = math.inf
    candidates: list[Candidate] = field(default_factory=list)
    survivals: list[FloatArray] = field(default_factory=list)

    @classmethod
    def of(cls, scenario: Scenario, ambiguity: Ambiguity, deadline: float = math.inf) -> _Game:
        """The game of a scenario, without paths."""
        require_default(scenario, "target.other", "a mixture of guides")
        cases = tuple(case.scenario.for_guide for case in scenario.cases)
        prior = np.array([case.weight for case in scenario.cases])
        start, initial = scenario.guide_start, scenario.swarm.initial_velocity
        task = GuideTask.from_scenario(cases[0], start, initial)
        return cls(cases, prior, ambiguity, task, make_solver("ipopt"), deadline)

    def guides(self, near: MixedGuide | None, progress: Progress | None) -> list[Guide]:
        """The guides of the cases; PlanningError if there is none for one of them."""
        found = []
        for number, case in enumerate(self.cases):
            if progress is not None:
                progress("planning the guides of the cases", number, len(self.cases))
            left = max(1e-3, self.deadline - time.monotonic()) / (len(self.cases) - number)
            options: dict[str, Any] = {"near": near and near.guides[number], "time_limit": left}
            initial = case.swarm.initial_velocity
            guide = plan_from(case, self.task.start, initial_velocity=initial, **options)
            if not guide.arrives:
                raise PlanningError(
                    f"no guide of case {number} arrives: see plan(scenario.cases[{number}]"
                    ".scenario)",
                    case=number,
                )
            found.append(guide)
        return found

    def multistart(self, weights: FloatArray, task: GuideTask | None = None) -> CasesMultistart:
        """Solves against a prior, whose zeros are slightly positive."""
        prior = np.maximum(weights, _LEAST)
        agent = self.cases[0], task or self.task, self.solver, None, self.deadline
        return CasesMultistart(*agent, self.cases, prior / prior.sum())

    def add(self, candidates: Sequence[Candidate]) -> None:
        """Add the paths that arrive."""
        for candidate in candidates:
            if np.isfinite(candidate.risk):
                self.candidates.append(candidate)
                positions = self.positions(candidate)
                self.survivals.append(survivals_of(self.cases, positions))

    def positions(self, candidate: Candidate) -> FloatArray:
        """X(0..T) of a candidate."""
        return integrate(self.task.start, candidate.velocities, self.task.dt)

    def solved(self) -> tuple[FloatArray, FloatArray]:
        """The best mixture (P,), and the worst prior (K,)."""
        return self.ambiguity.game(np.array(self.survivals), self.prior)

    @cached_property
    def tasks(self) -> list[Relaxation]:
        """Relaxations of the cases, to the part of the target where guides arrive."""
        tasks = [Relaxation.from_scenario(case, self.task.start) for case in self.cases]
        return [replace(task, radius=self.task.radius) for task in tasks]

    def best_path(self, prior: FloatArray) -> GridPath:
        """A path of great mean survival on a grid of nodes and beliefs."""
        rows = np.flatnonzero(prior > 0)
        tasks = [self.tasks[row] for row in rows]
        divisions = DIVISIONS[len(rows)]
        nodes = _SEARCHED // len(simplex(len(rows), divisions).points)
        grid = Grid.finest(tasks[0], nodes)
        program = BeliefProgram(tasks, grid, prior[rows], divisions, certified=False)
        path = best_belief_path(program)
        points = tasks[0].start + program.grid.spacing * np.array(path, float)
        return GridPath(points, program.grid.stride, "")

    def improve(self, weights: FloatArray, prior: FloatArray, on_grid: bool = True) -> bool:
        """Add the best path found against a prior; return False if it is no better.

        The search starts from the paths in use, and from one on a grid.
        """
        table, search = np.array(self.survivals), self.multistart(prior)
        starts = [self.candidates[row] for row in np.flatnonzero(weights > SUPPORT)]
        starts += [self.candidates[int((table @ prior).argmax())]]
        chosen = dict.fromkeys(starts)
        paths = [(GridPath(self.positions(c), 1, ""), len(c.velocities)) for c in chosen]
        if on_grid and np.count_nonzero(prior > 0) <= MAX_CASES:
            found_path = self.best_path(prior)
            paths += [(found_path, search.arrival_of(found_path))] if found_path.arrival else []
        before, known = len(self.candidates), float((table @ prior).max())
        for path, arrival in paths:
            self.add(search.candidates_along(path, {arrival - 1, arrival, arrival + 1}))
        found = np.array(self.survivals[before:])
        return len(found) > 0 and float((found @ prior).max()) > known * (1 + _ENOUGH)

    def run(
        self, guides: Sequence[Guide], near: MixedGuide | None, progress: Progress | None
    ) -> None:
        """Add paths until none is better against the worst prior; if near a mixture, a few."""
        for guide in guides:
            self.add(guide.best_per_homotopy_class())
        if near is None:
            for guide in guides:
                self.add(self.multistart(self.prior).candidates_near(guide))
        else:
            search = self.multistart(near.worst_prior)
            for path in near.paths:
                along = GridPath(path.positions, 1, "")
                self.add(search.candidates_along(along, [path.arrival]))
        for number in range(_ROUNDS if near is None else _ROUNDS_NEAR):
            weights, prior = self.solved()
            if progress is not None:
                progress("improving the mixture", number, None)
            late = time.monotonic() > self.deadline
            if late or not self.improve(weights, prior, near is None):
                return


def plan_mixture(
    scenario: Scenario,
    ambiguity: AmbiguityLike | Ambiguity = "mean",
    *,
    near: MixedGuide | None = None,
    certify: bool = True,
    gap: float = GAP,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> MixedGuide:
    """Best distribution over guides against a set of priors over the cases; see `plan`.

    If `near`, the mixture of a similar scenario with as many cases, is given, the search starts
    from its paths and guides only, in a fraction of the time.

    Raises
    ------
    PlanningError
        An unknown set of priors, or a case without a guide.
    ScenarioError
        Several target zones.
    """
    deadline = math.inf if time_limit is None else time.monotonic() + time_limit
    game = _Game.of(scenario, Ambiguity.of(ambiguity), deadline)
    guides = game.guides(near, progress)
    game.run(guides, near, progress)
    mixed = _mixed_guide(game, guides)
    if not certify:
        return mixed
    if progress is not None:
        progress("proving an upper bound", 0, None)
    limit = TIME_LIMIT if time_limit is None else max(0.0, deadline - time.monotonic())
    return _certified(game, mixed, gap, limit)


def _mixed_guide(game: _Game, guides: Sequence[Guide]) -> MixedGuide:
    """The best mixture of a game's paths, not certified."""
    table = np.array(game.survivals)
    rows, fields = of_game(game.ambiguity, table, game.prior)
    best = int(np.argmax([game.ambiguity.least(row, game.prior) for row in table]))
    return MixedGuide(
        paths=tuple(_guide(game, game.candidates[row]) for row in rows),
        pure=_guide(game, game.candidates[best]),
        guides=tuple(guides),
        known=np.maximum(np.exp([-guide.risk for guide in guides]), table.max(axis=0)),
        **fields,
    )


def _guide(game: _Game, candidate: Candidate) -> Guide:
    """The guide of a candidate, with the prior means of the rates of the cases."""
    positions = game.positions(candidate)
    rates = [case.rates_along(positions) for case in game.cases]
    return Guide(
        positions=positions,
        velocities=candidate.velocities,
        rates=game.prior @ np.array(rates),
        dt=game.task.dt,
        center=game.task.center,
        arrives=True,
        solution=candidate.solution,
        search="global",
    )


def certify_mixture(
    scenario: Scenario, mixed: MixedGuide, gap: float = GAP, time_limit: float = TIME_LIMIT
) -> MixedGuide:
    """A mixture of `plan_mixture` with a proven upper end of its value.

    The proof ends within `time_limit` seconds, or once the relative gap is at most `gap`.
    """
    game = _Game.of(scenario, mixed.ambiguity)
    others = [survivals_of(game.cases, one.positions) for one in (mixed.pure, *mixed.guides)]
    game.survivals = [*mixed.survivals, *others]
    return _certified(game, mixed, gap, time_limit)


def _certified(game: _Game, mixed: MixedGuide, gap: float, time_limit: float) -> MixedGuide:
    """The mixture with a proven upper end of its value, without limits of acceleration.

    Up to four cases it is the best value against the worst prior. More are divided into groups: an
    agent that knows the group of the true case has at least the value of one that does not.
    """
    tasks = [Relaxation.from_scenario(case, game.task.start) for case in game.cases]
    if not all(task.bounded for task in tasks):
        return replace(mixed, note="not certified: the rates have no lower bounds")
    prior, table = mixed.worst_prior, np.array(game.survivals)
    multiplier, groups = _multiplier(game, mixed, tasks), _groups(table * prior, prior)
    bounds = []
    for rows in groups:
        known = float((table[:, rows] @ prior[rows]).max())
        limits: dict[str, Any] = {"gap": gap, "time_limit": time_limit / len(groups)}
        own = [tasks[row] for row in rows]
        bounds.append(mixture_bound(own, prior[rows], known, multiplier, **limits))
    high = bounds[0].value
    notes = [] if np.isinf(game.task.a_max) else ["the bound ignores limits of acceleration"]
    if len(groups) > 1:
        high = min(1.0, math.fsum(bound.value for bound in bounds) * (1 + 1e-14))
        cases = " and ".join("/".join(map(str, rows)) for rows in groups)
        notes.append(f"it is of an agent that knows in which of these groups the case is: {cases}")
    bound = bounds[0] if len(groups) == 1 else None
    value = Interval(mixed.value.low, high)
    return replace(mixed, value=value, bound=bound, note="; ".join(notes))


def _groups(values: FloatArray, prior: FloatArray) -> list[list[int]]:
    """Groups of at most four of the possible cases, from the values (P, K) of paths.

    To a group are added the cases for which its best path is the worst: knowing them apart would
    gain the most.
    """
    left = [int(row) for row in np.argsort(-values.max(axis=0), kind="stable")]
    left = [row for row in left if prior[row] > 0]
    groups = []
    while left:
        group = [left.pop(0)]
        while left and len(group) < MAX_CASES:
            together = values[:, group].sum(axis=1)[:, None] + values[:, left]
            apart = values[:, group].sum(axis=1).max() + values[:, left].max(axis=0)
            group.append(left.pop(int((apart - together.max(axis=0)).argmax())))
        groups.append(sorted(group))
    return groups


def _multiplier(game: _Game, mixed: MixedGuide, tasks: Sequence[Relaxation]) -> float:
    """Decrease of -log of the value per increase of the target's radius, of relaxed paths.

    Every value is valid; that of the best paths without limits of acceleration is a good one.
    """
    radius = float(tasks[0].radius)
    free = replace(game.task, a_max=np.inf, a_max_first=np.inf, radius=radius)
    search = game.multistart(mixed.worst_prior, free)
    found = []
    for path in mixed.paths[:2]:
        candidates = search.candidates_along(GridPath(path.positions, 1, ""), [path.arrival])
        found += [game.positions(one) for one in candidates if np.isfinite(one.risk)]
    multipliers = []
    for positions in found:
        posterior = mixed.worst_prior * survivals_of(game.cases, positions)
        own = np.array([arrival_multiplier(task, positions) for task in tasks])
        multipliers.append(float(posterior @ own / posterior.sum()))
    return max(multipliers, default=0.0)

"""Multistart search for a guide: homotopy classes, arrival steps, and the outcome of each solve."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..grid.dynamic_programming import (
    Node,
    StageCosts,
    costs_to_come,
    costs_to_go,
    trace,
    trace_back,
)
from ..grid.nodes import Grid, NodeBlock, Relaxation, box_extremum
from ..hazard import Hazard
from ..motion.kinematics import integrate, remaining_distance, resample
from ..nlp.program import Instances, Nlp
from ..nlp.residuals import kkt_residuals
from ..nlp.solution import Solution, Status
from ..problems.guide import (
    GuideTask,
    guide_instance,
    guide_nlp,
    penalised_guide_instance,
    penalised_guide_nlp,
)
from ..scenario import Scenario
from ..scenario.variations import require_default
from ..solvers import Ipopt, Solver
from ..solvers.base import VIOLATION
from ..typing import FloatArray, Progress, Search
from .guide import Candidate, Guide

LOG = logging.getLogger(__name__)

STRAIGHT, GRID_PATH = "straight", "grid path"
"""Names of starts: along the straight line, and along a grid path where there are no radars."""

InitialPath = Callable[[int, float], FloatArray]
"""Velocities (steps, 2) of an initial path, for a number of steps and dt."""

_COARSE_STEPS = 8  # arrival steps tried first; the intervals next to the best are then bisected
_MAX_CLASSES = 4  # homotopy classes, in order of risk, from which a global search starts
_MAX_NEARBY_CLASSES = 3  # those of a neighbour's guide that a search near it starts from
_LONG_HORIZON = 100  # steps above which there are fewer starts, because solves take longer
_LONG_SOLVE = 1000  # steps from which every solve is reported, as of general solvers always
_REFINE_WITHIN = 1.1  # of the best risk: homotopy classes whose arrival time is refined

# With a smaller objective, the barrier of an interior-point method may push an initial path out of
# another homotopy class than the straight line's.
_SCALED_RISK = 100.0

# Paths that miss the target by less than the first, relative to its radius, are projected inside it
# by the second.
_NEARLY, _ROUNDING = 1e-5, 1e-9


def solve_by(deadline: float, solver: Solver, nlp: Nlp, instance: Instances) -> Solution:
    """Solution of a single instance, by a deadline if the solver can limit its time.

    A target that can only just be reached leaves a thin feasible set. Ipopt moves its guess away
    from bounds, and may then find the problem infeasible although the guess is feasible. It is
    solved again there from the guess itself, with several settings.
    """
    solution = _limited(solver, deadline).solve(nlp, instance)[0]
    careful_solvers = solver.from_feasible_guess()
    if solution.status is not Status.INFEASIBLE or not careful_solvers:
        return solution
    if kkt_residuals(nlp, instance, instance.x0[0]).violation > VIOLATION:
        return solution
    for careful in careful_solvers:
        if time.monotonic() >= deadline:
            break
        again = _limited(careful, deadline).solve(nlp, instance)[0]
        if again.status.success:
            return again
    return solution


def _limited(solver: Solver, deadline: float) -> Solver:
    """A solver that ends by the deadline, if it can limit its time.

    Its limit is a power of two, so that few of them are compiled.
    """
    left = deadline - time.monotonic()
    limit: float = getattr(solver, "time_limit", 0.0)
    if not solver.capabilities.time_limit or limit <= left:
        return solver
    power = math.floor(math.log2(max(left, 1e-2)))
    return replace(solver, time_limit=2.0**power)  # type: ignore[type-var]


_MAX_NODES = 150_000
_TILES = 16  # along the map's longer side
_MAX_TRACED = 24  # paths through the best nodes of tiles


def homotopy_signature(positions: FloatArray, radars: FloatArray) -> str:
    """Side on which a path passes every radar: L if it has the radar on its left, R on its right.

    The side is the sign of the angle that the path sweeps as seen from the radar, which
    distinguishes a path that goes around a radar from one that turns before it.

    Parameters
    ----------
    positions : (T+1, 2)
        Of the path.
    radars : (k, 2) or (T+1, k, 2)
        Positions of the radars, with each of the path if they move: then the angle is that of the
        path relative to the radar, and classes are for searching in several ones only.

    Returns
    -------
    str
        A letter for every radar, in their order.
    """
    moving = radars if radars.ndim == 3 else radars[None]
    offset = (positions[:, None] - moving).swapaxes(0, 1)
    angle = np.unwrap(np.arctan2(offset[..., 1], offset[..., 0]), axis=1)
    swept = angle[:, -1] - angle[:, 0] if radars.shape[-2] else np.empty(0)
    return "".join("L" if turn > 0 else "R" for turn in swept)


def _radars_along(hazard: Hazard, count: int, stride: int = 1) -> FloatArray:
    """Radars and zones beside a path's first `count` points, as `homotopy_signature` takes them."""
    if not hazard.changes:
        return hazard.landmarks
    return np.stack([hazard.after(stride * index).landmarks for index in range(count)])


@dataclass(frozen=True, eq=False)
class GridPath:
    """A path on the grid, without acceleration limits.

    Parameters
    ----------
    positions : (j+1, 2)
        From the start, every `stride` time steps, to the target's rim or next to it.
    stride : int
        Time steps from one position to the next.
    homotopy : str
        See `homotopy_signature`.
    """

    positions: FloatArray
    stride: int
    homotopy: str

    @property
    def arrival(self) -> int:
        """The arrival step."""
        return self.stride * (len(self.positions) - 1)

    def velocities(self, steps: int, dt: float) -> FloatArray:
        """Velocities (steps, 2) along the path, its timing stretched to `steps`."""
        return resample(self.positions, steps, dt, np.arange(float(len(self.positions))))


def best_homotopy_classes(task: Relaxation, max_classes: int) -> list[GridPath]:
    """The best grid path, and the best ones in other homotopy classes, in order of risk.

    Dynamic programming gives the least risk of the paths through every node at every sample, as
    the sum of cost to come and cost to go. Paths are traced through the best nodes of map tiles.
    """
    stage_costs = StageCosts(Grid.finest(task, _MAX_NODES), certified=False)
    grid = stage_costs.grid
    classes: dict[str, GridPath] = {}
    for nodes in _paths(stage_costs):
        if len(nodes) < 2:
            continue
        positions = task.start + grid.spacing * np.array(nodes, float)
        radars = _radars_along(task.hazard, len(positions), grid.stride)
        homotopy = homotopy_signature(positions, radars)
        classes.setdefault(homotopy, GridPath(positions, grid.stride, homotopy))
        if len(classes) == max_classes:
            break
    return list(classes.values())


def _paths(stage_costs: StageCosts) -> Iterator[list[Node]]:
    """The best path, then the best ones through local minima a quarter, half and 3/4 along."""
    to_go, to_come = costs_to_go(stage_costs), list(costs_to_come(stage_costs))
    best = trace(stage_costs, to_go)
    yield best
    waypoints = []
    quarters = (0.25, 0.5, 0.75)
    for sample in sorted({max(1, round(part * (len(best) - 1))) for part in quarters}):
        at = sample - 1
        for nodes, come, go in zip(stage_costs.grid.nodes[at], to_come[at], to_go[at], strict=True):
            for risk, (i, j) in _local_minima(come + go):
                waypoints.append((risk, sample, (nodes.first[0] + i, nodes.first[1] + j)))
    for _, sample, node in sorted(waypoints)[:_MAX_TRACED]:
        first_part = trace_back(stage_costs, to_come, node, sample)
        yield first_part + trace(stage_costs, to_go, node, sample)


def _local_minima(totals: FloatArray) -> Iterator[tuple[float, Node]]:
    """Least value and its node in every tile that is no worse than its neighbouring tiles."""
    size = max(1, -(-max(totals.shape) // _TILES))
    rows, columns = (-(-n // size) for n in totals.shape)
    tiles = np.full((rows * size, columns * size), np.inf)
    tiles[: totals.shape[0], : totals.shape[1]] = totals
    tiles = tiles.reshape(rows, size, columns, size).transpose(0, 2, 1, 3)
    tiles = tiles.reshape(rows, columns, -1)
    best, at = tiles.min(axis=-1), tiles.argmin(axis=-1)
    all_tiles = NodeBlock((0, 0), best.shape)
    local = np.isfinite(best) & (best <= box_extremum(best, all_tiles, all_tiles, 1))
    for row, column in zip(*np.nonzero(local), strict=True):
        inner = divmod(int(at[row, column]), size)
        node = (int(row) * size + inner[0], int(column) * size + inner[1])
        yield float(best[row, column]), node


def preference(candidate: Candidate) -> tuple[bool, bool, float, str, float]:
    """Sort key: candidates that arrive come first, then those that are solved, then by risk.

    Of risks that agree in nine digits, as of images in symmetric scenarios, the homotopy decides:
    otherwise it would be the rounding of the last one.
    """
    arrives, risk = bool(np.isfinite(candidate.risk)), candidate.risk
    solved = candidate.solution.status.success
    return not arrives, not solved, float(f"{risk:.8e}"), candidate.homotopy, risk


@dataclass(frozen=True)
class Multistart:
    """Solves of one agent's guide problem, from several starts and for several arrival steps.

    Parameters
    ----------
    scenario : Scenario
    task : GuideTask
        Of the agent.
    solver : Solver
    progress : Progress, optional
        Receives what is being solved.
    deadline : float
        Time of `time.monotonic` after which no solve starts; solvers that can limit their time end
        by then.
    """

    scenario: Scenario
    task: GuideTask
    solver: Solver
    progress: Progress | None = None
    deadline: float = math.inf

    @property
    def expired(self) -> bool:
        """True if the deadline has passed."""
        return time.monotonic() >= self.deadline

    def candidates(self, search: Search) -> list[Candidate]:
        """Outcomes of every start of a local or global search."""
        starts: dict[str, InitialPath] = {STRAIGHT: self._straight}
        steps = {STRAIGHT: self._coarse_steps()}
        if search == "global" and not self.expired:
            is_long = self.scenario.n_steps > _LONG_HORIZON
            relaxation = Relaxation.from_scenario(self.scenario, self.task.start)
            relaxation = replace(relaxation, radius=self.task.radius)
            for path in best_homotopy_classes(relaxation, 2 if is_long else _MAX_CLASSES):
                starts[_name(path)] = path.velocities
                steps[_name(path)] = self._steps_near(self.arrival_of(path))
            steps[STRAIGHT] = self._coarse_steps(1 if is_long else 3)
        outcomes: dict[str, list[Candidate]] = {}
        for name, start in starts.items():
            self._report(name)
            outcomes[name] = list(self._solve(name, start, steps[name]))
        if self.scenario.guide.arrival == "any":
            for name in self._most_promising(outcomes):
                self._report(name, " (arrival time)")
                self._refine(name, starts[name], outcomes[name])
        return [candidate for candidates in outcomes.values() for candidate in candidates]

    def arrival_of(self, path: GridPath) -> int:
        """Step of the scenario in which a grid path arrives: the grid's are parts of steps."""
        return -(-path.arrival // self.scenario.time.substeps)

    def candidates_along(self, path: GridPath, steps: Iterable[int]) -> list[Candidate]:
        """Outcomes of the start along a grid path, at the feasible ones of the arrival steps."""
        feasible = sorted(set(self._feasible_steps()).intersection(steps))
        return list(self._solve(_name(path), path.velocities, feasible))

    def candidates_near(self, guide: Guide) -> list[Candidate]:
        """Outcomes of starts along another agent's guide and its other homotopy classes."""
        feasible = self._feasible_steps()
        outcomes: list[Candidate] = []
        for neighbour in guide.best_per_homotopy_class()[:_MAX_NEARBY_CLASSES]:
            path = integrate(guide.positions[0], neighbour.velocities, self.task.dt)
            nearby = {neighbour.arrival + shift for shift in (-1, 0, 1)}
            steps = sorted(nearby.intersection(feasible)) or feasible[-1:]
            polyline = np.vstack([self.task.start, path[1:]])
            outcomes += self._solve(neighbour.start, partial(resample, polyline), steps)
        return outcomes

    def penalised(self) -> Candidate:
        """Outcome of the paper's penalised form, from the straight line over all steps."""
        for key in ("time.substeps", "swarm.speed"):
            require_default(self.scenario, key, "the paper's penalised form")
        task = replace(self.task, radius=self.scenario.target.radius)
        steps = self.scenario.n_steps
        nlp = penalised_guide_nlp(self.scenario.hazard, steps)
        line = resample(np.stack([task.start, task.center]), steps, task.dt)
        instance = penalised_guide_instance(nlp, task, self.scenario.guide.gamma, line)
        self._report(STRAIGHT)
        solution = self.solver.solve(nlp, instance)[0]
        velocities = nlp.variable("velocities", solution.x)
        return self._candidate(STRAIGHT, steps, velocities, solution)

    def _report(self, name: str, detail: str = "") -> None:
        if self.progress is not None:
            self.progress(f"optimising {_described(name)}{detail}", 0, None)

    def _report_solve(self, name: str, arrival: int, number: str) -> None:
        """Report a solve that may take more than a second: not one by Ipopt of a usual length."""
        steps = self.scenario.n_steps
        if steps >= _LONG_SOLVE or self.solver.name != Ipopt.name:
            detail = f", solve {number} by {self.solver.name}, {arrival} of at most {steps} steps"
            self._report(name, detail)

    def _solve(self, name: str, start: InitialPath, steps: Sequence[int]) -> Iterator[Candidate]:
        nlp = self.program
        for number, arrival in enumerate(steps, 1):
            if self.expired:
                return
            self._report_solve(name, arrival, f"{number} of {len(steps)}")
            guess = start(arrival, self.task.dt)
            scale = 1.0 if name == STRAIGHT else self._scale(guess)
            instance = self.instance(nlp, arrival, guess, scale)
            solution = solve_by(self.deadline, self.solver, nlp, instance)
            residuals = replace(
                solution.residuals,
                stationarity=solution.residuals.stationarity / scale,
                complementarity=solution.residuals.complementarity / scale,
            )
            solution = replace(solution, objective=solution.objective / scale, residuals=residuals)
            LOG.debug("%s, %d steps: %s", _described(name), arrival, solution)
            velocities = self.task.v_max * nlp.variable("velocities", solution.x)[:arrival]
            yield self._candidate(name, arrival, velocities, solution)

    def _scale(self, velocities: FloatArray) -> float:
        """Factor by which the risk of an initial path becomes `_SCALED_RISK`."""
        positions = integrate(self.task.start, velocities, self.task.dt)
        risk = self.risk(positions)
        return _SCALED_RISK / risk if 0 < risk < np.inf else 1.0

    @property
    def program(self) -> Nlp:
        """The program of all starts and arrival steps."""
        hazard, time = self.scenario.by_parts.hazard, self.scenario.time
        return guide_nlp(hazard, self.scenario.n_steps, time.substeps, self.task.disc)

    def instance(self, nlp: Nlp, arrival: int, guess: FloatArray, scale: float) -> Instances:
        """Instance of the program for an arrival step, with velocities (T, 2) as a guess."""
        return guide_instance(nlp, self.task, arrival, guess, scale)

    def risk(self, positions: FloatArray) -> float:
        """Objective of a path (T+1, 2) that arrives."""
        return float(self.task.dt * self.scenario.rates_along(positions).sum())

    def _refine(self, name: str, start: InitialPath, outcomes: list[Candidate]) -> None:
        """Bisect the intervals of arrival steps next to the best one, and extend `outcomes`.

        For long guides, down to a hundredth of their length.
        """
        while outcomes and not self.expired:
            best = min(outcomes, key=preference).arrival
            steps = np.array(sorted({candidate.arrival for candidate in outcomes}))
            at = int(np.searchsorted(steps, best))
            neighbours = [int(steps[i]) for i in (at - 1, at + 1) if 0 <= i < len(steps)]
            between = {(step + best) // 2 for step in neighbours if abs(step - best) > best // 100}
            untried = between - set(steps.tolist())
            if not untried:  # a neighbour may be one step above: (best + 1 + best) // 2 = best
                return
            outcomes += self._solve(name, start, sorted(untried))

    def _most_promising(self, outcomes: dict[str, list[Candidate]]) -> list[str]:
        """Starts to refine: the best one of each homotopy class, at most two.

        Classes of much higher risk are skipped: another arrival step does not make up for it.
        """
        best = {name: min(tried, key=preference) for name, tried in outcomes.items() if tried}
        chosen: dict[str, str] = {}
        for name in sorted(best, key=lambda start: preference(best[start])):
            chosen.setdefault(best[name].homotopy, name)
        limit = _REFINE_WITHIN * min(
            (candidate.risk for candidate in best.values()), default=np.inf
        )
        return [name for name in chosen.values() if best[name].risk <= limit][:2] or [STRAIGHT]

    def _candidate(
        self, name: str, arrival: int, velocities: FloatArray, solution: Solution
    ) -> Candidate:
        """The candidate of a solution, with its risk up to the first arrival."""
        task, hazard = self.task, self.scenario.hazard
        finite = np.isfinite(velocities).all()
        velocities = self._repaired(velocities) if finite else np.zeros_like(velocities)
        positions = integrate(task.start, velocities, task.dt)
        risk = np.inf
        inside = self.scenario.target.contains(positions[1:])
        if inside.any() and solution.residuals.violation <= VIOLATION:
            first = int(inside.argmax()) + 1
            velocities, positions = velocities[:first], positions[: first + 1]
            risk = self.risk(positions)
        homotopy = homotopy_signature(positions, _radars_along(hazard, len(positions)))
        return Candidate(name, arrival, homotopy, velocities, risk, solution)

    def _repaired(self, velocities: FloatArray) -> FloatArray:
        """Velocities clipped to the speed limit, ending in the target if they nearly do.

        The residuals of the dynamics, each within a solver's tolerance, add up over the steps.
        """
        task, radius = self.task, self.scenario.target.radius
        velocities = task.limited(velocities)
        offset = integrate(task.start, velocities, task.dt)[-1] - task.center
        distance = float(np.hypot(*offset))
        missing = distance - (1 - _ROUNDING) * radius
        if not _ROUNDING * radius < missing <= _NEARLY * radius:
            return velocities
        correction = -missing / distance * offset / task.dt  # summed over the steps
        slack = task.v_max - velocities * np.sign(correction)
        # the same change at every step leaves accelerations as they are
        weights = np.where(np.isinf(task.a_max) and not task.disc, slack, 1.0)
        weights = weights / np.maximum(weights.sum(axis=0), 1e-300)
        return task.limited(velocities + weights * correction)

    def _straight(self, steps: int, dt: float) -> FloatArray:
        """Velocities (steps, 2) straight to the nearest point of the target less its margin."""
        offset = self.task.start - self.task.center
        distance = np.hypot(*offset)
        shrink = min(1.0, self.task.radius / distance) if distance > 0 else 1.0
        goal = self.task.center + shrink * offset
        return resample(np.stack([self.task.start, goal]), steps, dt)

    def _coarse_steps(self, count: int = _COARSE_STEPS) -> list[int]:
        """Arrival steps, at most `count`, evenly spaced from the first feasible one to the last."""
        feasible = self._feasible_steps()
        indices = np.linspace(0, len(feasible) - 1, min(count, len(feasible))).round()
        return [feasible[int(index)] for index in indices]

    def _steps_near(self, arrival: int) -> list[int]:
        """Arrival steps next to `arrival`, and the last one: limited acceleration takes time."""
        feasible = self._feasible_steps()
        nearest = min(feasible, key=lambda step: abs(step - arrival))
        steps = {nearest, feasible[-1]}
        if self.scenario.n_steps <= _LONG_HORIZON:
            steps |= {nearest - 1, nearest + 1}
        return sorted(steps.intersection(feasible))

    def _feasible_steps(self) -> list[int]:
        """Arrival steps that v_max and the scenario allow; the horizon if there are none."""
        horizon = self.scenario.n_steps
        reach = np.arange(1, horizon + 1)[:, None] * self.task.dt * self.task.v_max
        distance = remaining_distance(self.task.start, self.task.center, reach)
        if self.task.disc:
            distance = np.hypot(*(self.task.center - self.task.start)) - reach[:, 0]
        feasible = 1 + np.flatnonzero(distance <= self.task.radius)
        if not feasible.size or self.scenario.guide.arrival == "horizon":
            return [horizon]
        return [int(step) for step in feasible]


def _described(name: str) -> str:
    """A start in words, by its name."""
    others = {STRAIGHT: "straight line", GRID_PATH: GRID_PATH}
    return others.get(name, f"homotopy class {name}")


def _name(path: GridPath) -> str:
    return path.homotopy or GRID_PATH

"""The search for a guide: which starts, which arrival steps, and what became of each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..optimization.solution import Solution
from ..optimization.solvers import Solver
from ..optimization.solvers.base import VIOLATION
from ..problems.guide import GuideTask, guide_instance, guide_nlp
from ..problems.guide_penalty import penalised_guide_instance, penalised_guide_nlp
from ..typing import FloatArray
from .bounds.grid import Relaxation
from .guide import Candidate, Guide, homotopy_signature, integrate
from .homotopy import GridPath, best_homotopy_classes
from .polyline import resampled, straight

if TYPE_CHECKING:
    from ..scenario import Scenario

COARSE = 8
"""Arrival steps tried first, evenly spread; the best one's neighbourhood is then halved to one."""

WAYS = 4
"""Ways around the radars, best first, from which a global search starts."""

LONG = 100
"""Steps beyond which a global search tries fewer starts: each solve takes its time."""

CLOSE = 1.1
"""Risk of a way, relative to the best one's, up to which its arrival step is refined."""

OBJECTIVE = 100.0
"""Risk of a way as solvers see it: with less, the barrier of an interior point method may push it
to other sides of the radars. A straight start, which is not to be kept, is not scaled."""

NEARLY, ROUNDING = 1e-5, 1e-9
"""Relative distances from the target's rim: that of paths which a solver's tolerance has kept out,
and where those end that are mended."""

NEAR = 3
"""Ways of a known guide, best first, that a search near it starts from."""


def preference(candidate: Candidate) -> tuple[bool, bool, float]:
    """Arriving and solved first, then by risk."""
    arrives = bool(np.isfinite(candidate.risk))
    return not arrives, not candidate.solution.status.success, candidate.risk


Start = Callable[[int, float], FloatArray]
"""Velocities (steps, 2) of an initial path, from a number of steps and dt."""


def _resampling(polyline: FloatArray) -> Start:
    return lambda steps, dt: resampled(polyline, steps, dt)


@dataclass(frozen=True)
class Multistart:
    """Solves of one agent's guide problem, from several starts and for several arrival steps.

    Parameters
    ----------
    scenario : Scenario
    task : GuideTask
    solver : Solver
    progress : callable
        Called with the name of every start.
    """

    scenario: Scenario
    task: GuideTask
    solver: Solver
    progress: Callable[[str], None]

    def candidates(self, search: str) -> list[Candidate]:
        """Outcomes of every start of a local or global search."""
        found: dict[str, list[Candidate]] = {}
        starts: dict[str, Start] = {"straight": self._line}
        steps = {"straight": self._steps()}
        if search == "global":
            relaxation = replace(
                Relaxation.of(self.scenario, self.task.start), radius=self.task.radius
            )
            long = self.scenario.n_steps > LONG
            ways = best_homotopy_classes(relaxation, 2 if long else WAYS)
            starts |= {way.sides or "way": way.velocities for way in ways}
            steps |= {way.sides or "way": self._steps_near(way.arrival) for way in ways}
            steps["straight"] = self._steps(1 if long else 3)
        for name, start in starts.items():
            self.progress(name)
            found[name] = list(self._try(name, start, steps[name]))
        refined = self._most_promising(found) if self.scenario.guide.arrival == "any" else []
        for name in refined:
            self.progress(f"{name}, arrival step")
            self._refine(name, starts[name], found[name])
        return [candidate for tried in found.values() for candidate in tried]

    def along(self, way: GridPath, steps: Iterable[int]) -> list[Candidate]:
        """Outcomes of a way at those of the arrival steps that are possible."""
        possible = set(self._possible())
        return list(
            self._try(way.sides or "way", way.velocities, sorted(possible.intersection(steps)))
        )

    def candidates_near(self, guide: Guide) -> list[Candidate]:
        """Outcomes of starts that follow another agent's guide and its other ways."""
        possible = self._possible()
        tried: list[Candidate] = []
        for known in guide.ways()[:NEAR]:
            path = integrate(guide.positions[0], known.velocities, self.task.dt)
            around_known = {known.arrival + shift for shift in (-1, 0, 1)}
            steps = sorted(around_known.intersection(possible)) or possible[-1:]
            polyline = np.vstack([self.task.start, path[1:]])
            tried += self._try(known.start, _resampling(polyline), steps)
        return tried

    def penalised(self) -> Candidate:
        """Outcome of the paper's penalised form, from the straight line over all steps."""
        task = replace(self.task, radius=self.scenario.target.radius)
        nlp = penalised_guide_nlp(self.scenario.hazard, self.scenario.n_steps)
        line = resampled(straight(task.start, task.center), self.scenario.n_steps, task.dt)
        instance = penalised_guide_instance(nlp, task, self.scenario.guide.gamma, line)
        self.progress("straight")
        solution = self.solver.solve(nlp, instance)[0]
        velocities = nlp.variable("velocities", solution.x)
        return self._priced("straight", self.scenario.n_steps, velocities, solution)

    def _try(self, name: str, start: Start, steps: Iterable[int]) -> Iterator[Candidate]:
        nlp = guide_nlp(self.scenario.hazard, self.scenario.n_steps)
        task, unit = self.task.dimensionless(), self.task.v_max
        for arrival in steps:
            guess = start(arrival, self.task.dt)
            scale = 1.0 if name == "straight" else self._scale(guess)
            instance = guide_instance(nlp, task, arrival, guess / unit, scale)
            solution = self.solver.solve(nlp, instance)[0]
            residuals = replace(
                solution.residuals,
                stationarity=solution.residuals.stationarity / scale,
                complementarity=solution.residuals.complementarity / scale,
            )
            solution = replace(solution, objective=solution.objective / scale, residuals=residuals)
            velocities = unit * nlp.variable("velocities", solution.x)[:arrival]
            yield self._priced(name, arrival, velocities, solution)

    def _scale(self, velocities: FloatArray) -> float:
        """What makes the objective of a start `OBJECTIVE`."""
        positions = integrate(self.task.start, velocities, self.task.dt)
        risk = float(self.task.dt * self.scenario.hazard.single_agent_rates(positions[1:]).sum())
        return OBJECTIVE / risk if 0 < risk < np.inf else 1.0

    def _refine(self, name: str, start: Start, tried: list[Candidate]) -> None:
        """Try arrival steps between the best one and its neighbours until none is left.

        Of long guides, to a hundredth of their length.
        """
        while True:
            best = min(tried, key=preference).arrival
            steps = np.array(sorted({c.arrival for c in tried}))
            at = int(np.searchsorted(steps, best))
            near = [int(steps[i]) for i in (at - 1, at + 1) if 0 <= i < len(steps)]
            between = {(step + best) // 2 for step in near if abs(step - best) > best // 100}
            fresh = between - set(steps.tolist())
            if not fresh:  # a neighbour may be one step above: (best + 1 + best) // 2 = best
                return
            tried += self._try(name, start, sorted(fresh))

    def _most_promising(self, found: dict[str, list[Candidate]]) -> list[str]:
        """Starts to refine: the best of each way around the radars, at most two of them.

        None that is far behind: another arrival step does not make up for the wrong way.
        """
        best = {name: min(tried, key=preference) for name, tried in found.items()}
        chosen: dict[str, str] = {}
        for name in sorted(best, key=lambda start: preference(best[start])):
            chosen.setdefault(best[name].sides, name)
        limit = CLOSE * min((candidate.risk for candidate in best.values()), default=np.inf)
        return [name for name in chosen.values() if best[name].risk <= limit][:2] or ["straight"]

    def _priced(
        self, name: str, arrival: int, velocities: FloatArray, solution: Solution
    ) -> Candidate:
        task = self.task
        finite = np.isfinite(velocities).all()
        velocities = self._mended(velocities) if finite else np.zeros_like(velocities)
        positions = integrate(task.start, velocities, task.dt)
        risk = np.inf
        inside = self.scenario.target.contains(positions[1:])
        if inside.any() and solution.residuals.violation <= VIOLATION:
            first = int(inside.argmax()) + 1
            velocities, positions = velocities[:first], positions[: first + 1]
            risk = float(task.dt * self.scenario.hazard.single_agent_rates(positions[1:]).sum())
        radars = self.scenario.hazard.radar_positions
        return Candidate(
            name, arrival, homotopy_signature(positions, radars), velocities, risk, solution
        )

    def _mended(self, velocities: FloatArray) -> FloatArray:
        """Velocities within the speed limit, and ending in the target if they nearly do.

        What a solver's tolerance leaves of the dynamics adds up over the steps.
        """
        task, radius = self.task, self.scenario.target.radius
        velocities = np.clip(velocities, -task.v_max, task.v_max)
        away = integrate(task.start, velocities, task.dt)[-1] - task.center
        distance = float(np.hypot(*away))
        missing = distance - (1 - ROUNDING) * radius
        if not ROUNDING * radius < missing <= NEARLY * radius:
            return velocities
        towards = -missing / distance * away / task.dt  # sum of the changes
        room = task.v_max - velocities * np.sign(towards)
        share = np.where(np.isinf(task.a_max), room, 1.0)  # all alike leave accelerations alone
        share = share / np.maximum(share.sum(axis=0), 1e-300)
        return np.asarray(np.clip(velocities + share * towards, -task.v_max, task.v_max))

    def _line(self, steps: int, dt: float) -> FloatArray:
        """Velocities (steps, 2) straight to the nearest point of the target, margin taken off."""
        way = self.task.start - self.task.center
        distance = np.hypot(*way)
        shrink = min(1.0, self.task.radius / distance) if distance > 0 else 1.0
        return resampled(straight(self.task.start, self.task.center + shrink * way), steps, dt)

    def _steps(self, most: int = COARSE) -> list[int]:
        """Arrival steps to try first: from the fewest possible to all, evenly."""
        possible = self._possible()
        places = np.linspace(0, len(possible) - 1, min(most, len(possible))).round()
        return [possible[int(place)] for place in places]

    def _steps_near(self, arrival: int) -> list[int]:
        """Arrival steps around one, and the last: limits of acceleration take their time."""
        possible = self._possible()
        nearest = min(possible, key=lambda step: abs(step - arrival))
        near = {nearest, possible[-1]}
        if self.scenario.n_steps <= LONG:
            near |= {nearest - 1, nearest + 1}
        return sorted(near.intersection(possible))

    def _possible(self) -> list[int]:
        """Arrival steps that v_max allows and the scenario asks for, or else the horizon."""
        horizon = self.scenario.n_steps
        reach = np.arange(1, horizon + 1)[:, None] * self.task.dt * self.task.v_max
        outside = np.maximum(np.abs(self.task.center - self.task.start) - reach, 0.0)
        possible = 1 + np.flatnonzero(np.hypot(*outside.T) <= self.task.radius)
        if not possible.size or self.scenario.guide.arrival == "horizon":
            return [horizon]
        return [int(step) for step in possible]

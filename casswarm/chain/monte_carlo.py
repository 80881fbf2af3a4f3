"""The controlled Markov chain, sampled: all runs of a policy advance together.

A step of the paper's section II.C, for every run at once: observe positions and who is alive,
decide, move, and draw who survives from the rates at the new positions with the old alive,
P(i survives) = exp(-dt lambda_i(X(t+1), alive(t))). A run ends at the first arrival of a living
member, at the last destruction, or at the horizon.

Policies are deterministic, so runs in equal states share one decision and one evaluation of rates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, IntArray
from .random_streams import uniforms
from .states import States, distinct_states
from .trajectories import RunTrajectory, TrajectoryRecorder
from .transition import transition

if TYPE_CHECKING:
    from ..scenario import Scenario


@dataclass(frozen=True, eq=False)
class Runs:
    """Outcomes of R runs, an entry each.

    Parameters
    ----------
    first : int
        Index of the first run.
    arrival : (R,) int
        The step of the first arrival of a living member, -1 where there is none.
    survivors : (R,) int
        Members alive at the end of the run.
    steps : (R,) int
        Length of the run.
    infeasible : (R,) int
        Member-steps in which a wish could not be fulfilled.
    solver_failures : (R,) int
        Steps in which the solver failed.
    fallbacks : (R,) int
        Steps in which a first answer was not good enough and Ipopt was called.
    saturated : (R,) int
        Member-steps in which the policy asked for more than v_max or a_max, and got the nearest
        velocity that they allow.
    states : int
        Distinct states in which the policy was asked.
    traces : tuple of Trace
        The ways of the first runs.
    """

    first: int
    arrival: IntArray
    survivors: IntArray
    steps: IntArray
    infeasible: IntArray
    solver_failures: IntArray
    fallbacks: IntArray
    saturated: IntArray
    states: int
    traces: tuple[RunTrajectory, ...]

    @property
    def end(self) -> int:
        """Index after the last run."""
        return self.first + len(self.arrival)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it as arrays by name, to be kept."""
        found: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in _COUNTS}
        found |= {"first": np.array(self.first), "states": np.array(self.states)}
        for place, trace in enumerate(self.traces):
            found[f"positions-{place}"], found[f"alive-{place}"] = trace.positions, trace.alive
            found[f"leaders-{place}"] = trace.leaders
        return found

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Runs:
        """The runs of `arrays`, again."""
        number = sum(name.startswith("positions-") for name in arrays)
        return cls(
            first=int(arrays["first"]),
            states=int(arrays["states"]),
            traces=tuple(
                RunTrajectory(
                    *(arrays[f"{part}-{k}"] for part in ("positions", "alive", "leaders"))
                )
                for k in range(number)
            ),
            **{name: arrays[name] for name in _COUNTS},
        )


_COUNTS = (
    "arrival",
    "survivors",
    "steps",
    "infeasible",
    "solver_failures",
    "fallbacks",
    "saturated",
)


@dataclass(frozen=True, eq=False)
class Chain:
    """What the chain needs besides a policy, as plain data that can be sent to a worker.

    Parameters
    ----------
    scenario : Scenario
    before : (n, 2)
        V(-1).
    seed : int
    """

    scenario: Scenario
    before: FloatArray
    seed: int

    def run(
        self,
        policy: Policy,
        first: int,
        runs: int,
        traces: int = 0,
        progress: Callable[[int], None] | None = None,
    ) -> Runs:
        """Sample the runs `first`, ..., `first` + `runs` - 1 under a policy.

        Parameters
        ----------
        policy : Policy
        first, runs : int
        traces : int
            How many of these runs, from the first, keep their way.
        progress : callable, optional
            Called after every step with the number of runs that have ended by then.

        Raises
        ------
        PolicyError, HazardError
            Velocities or rates that are not finite or of the wrong shape.
        """
        scenario = self.scenario
        swarm = _RunBatch.start(scenario, self.before, runs, traces)
        for step in range(scenario.n_steps):
            active = np.flatnonzero(swarm.running)
            if not active.size:
                break
            draws = uniforms(self.seed, step, first, runs, scenario.n)[active]
            swarm.advance(scenario, policy, step, active, draws)
            if progress is not None:
                progress(runs - int(swarm.running.sum()))
        return swarm.outcome(first)

    def finish(self, policy: Policy, states: States, steps: IntArray) -> Runs:
        """Sample runs that begin in the given states, one each, at the given steps.

        Parameters
        ----------
        policy : Policy
        states : States
            R states; their weights do not matter.
        steps : (R,) int
            The step t of each.
        """
        swarm = _RunBatch.within(states, steps)
        for step in range(self.scenario.n_steps):
            active = np.flatnonzero(swarm.running & (steps <= step))
            if active.size:
                draws = uniforms(self.seed, step, 0, len(states), self.scenario.n)[active]
                swarm.advance(self.scenario, policy, step, active, draws)
        return swarm.outcome(0)


@dataclass
class _RunBatch:
    """R swarms on their way; the entries of the destroyed are zero."""

    positions: FloatArray
    previous_velocities: FloatArray
    alive: BoolArray
    running: BoolArray
    arrival: IntArray
    steps: IntArray
    infeasible: IntArray
    failures: IntArray
    fallbacks: IntArray
    saturated: IntArray
    states: int
    tracer: TrajectoryRecorder

    @classmethod
    def start(cls, scenario: Scenario, before: FloatArray, runs: int, traces: int) -> _RunBatch:
        states = States(
            np.tile(scenario.positions, (runs, 1, 1)),
            np.tile(before, (runs, 1, 1)),
            np.ones((runs, scenario.n), bool),
            np.ones(runs),
        )
        return cls.within(states, np.zeros(runs, np.int64), traces)

    @classmethod
    def within(cls, states: States, steps: IntArray, traces: int = 0) -> _RunBatch:
        """Swarms in these states, which are not changed, at these steps."""
        zeros = np.zeros(len(states), np.int64)
        return cls(
            positions=states.positions.copy(),
            previous_velocities=states.previous_velocities.copy(),
            alive=states.alive.copy(),
            running=np.ones(len(states), bool),
            arrival=zeros - 1,
            steps=steps.copy(),
            infeasible=zeros.copy(),
            failures=zeros.copy(),
            fallbacks=zeros.copy(),
            saturated=zeros.copy(),
            states=0,
            tracer=TrajectoryRecorder(
                [states.positions[:traces].copy()], [states.alive[:traces].copy()], []
            ),
        )

    def advance(
        self, scenario: Scenario, policy: Policy, step: int, active: IntArray, draws: FloatArray
    ) -> None:
        """Take the active runs from `step` to step + 1; `draws` (len(active), n) are uniform."""
        first, back = distinct_states(
            self.positions[active], self.previous_velocities[active], self.alive[active]
        )
        rows = active[first]
        alive = self.alive[rows]
        move = transition(
            scenario, policy, step, self.positions[rows], self.previous_velocities[rows], alive
        )
        survives = alive[back] & (draws < move.survival[back])
        arrived = (survives & move.inside[back]).any(axis=1)
        self.states += len(rows)
        self.tracer.lead(active, policy, step, self.positions, self.previous_velocities, self.alive)
        self.infeasible[active] += move.infeasible[back]
        self.failures[active] += move.failures[back]
        self.fallbacks[active] += move.fallbacks[back]
        self.saturated[active] += move.saturated[back]
        self.positions[active] = np.where(survives[..., None], move.positions[back], 0.0)
        self.previous_velocities[active] = np.where(survives[..., None], move.velocities[back], 0.0)
        self.alive[active] = survives
        self.steps[active] = step + 1
        self.arrival[active[arrived]] = step + 1
        self.running[active] = survives.any(axis=1) & ~arrived
        self.tracer.record(active, move.positions[back], self.alive)

    def outcome(self, first: int) -> Runs:
        """The runs' outcomes, once they have all ended or the horizon is reached."""
        return Runs(
            first=first,
            arrival=self.arrival,
            survivors=self.alive.sum(axis=1),
            steps=self.steps,
            infeasible=self.infeasible,
            solver_failures=self.failures,
            fallbacks=self.fallbacks,
            saturated=self.saturated,
            states=self.states,
            traces=self.tracer.traces(self.steps),
        )

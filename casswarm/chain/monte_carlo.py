"""Monte Carlo simulation of the controlled Markov chain: all runs of a policy advance together.

A step of the paper's section II.C, for every run at once: observe positions and living members,
decide, move, and draw the survivors from the rates at the new positions with the old living
members, P(i survives) = exp(-dt lambda_i(X(t+1), alive(t))). A run ends at the first arrival of a
living member, at the last destruction, or at the horizon.

Policies are deterministic, so runs in equal states share one decision and one evaluation of rates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, IntArray, Progress
from .random_streams import uniforms
from .states import States, distinct_states
from .trajectories import RunTrajectory, TrajectoryRecorder
from .transition import transition

if TYPE_CHECKING:
    from ..scenario import Scenario

_DECISION_COUNTS = ("infeasible", "solver_failures", "fallbacks", "saturated")
_RUN_ARRAYS = ("arrival", "survivors", "steps", *_DECISION_COUNTS)
_TRAJECTORY_ARRAYS = ("positions", "alive", "leaders")


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
        Member-steps in which a soft constraint could not be met.
    solver_failures : (R,) int
        Steps in which the solver failed.
    fallbacks : (R,) int
        Steps in which a first solution was not good enough and Ipopt was called.
    saturated : (R,) int
        Member-steps in which the policy exceeded v_max or a_max, and its velocity was projected.
    states : int
        Number of distinct states in which the policy was evaluated.
    trajectories : tuple of RunTrajectory
        Trajectories of the first runs.
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
    trajectories: tuple[RunTrajectory, ...]

    @property
    def end(self) -> int:
        """Index after the last run."""
        return self.first + len(self.arrival)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Named arrays from which `from_arrays` restores the runs."""
        arrays: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in _RUN_ARRAYS}
        arrays |= {"first": np.array(self.first), "states": np.array(self.states)}
        for k, trajectory in enumerate(self.trajectories):
            for name in _TRAJECTORY_ARRAYS:
                arrays[f"{name}-{k}"] = getattr(trajectory, name)
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Runs:
        """Runs that were stored by `to_arrays`."""
        number = sum(name.startswith("positions-") for name in arrays)
        return cls(
            first=int(arrays["first"]),
            states=int(arrays["states"]),
            trajectories=tuple(
                RunTrajectory(*(arrays[f"{name}-{k}"] for name in _TRAJECTORY_ARRAYS))
                for k in range(number)
            ),
            **{name: arrays[name] for name in _RUN_ARRAYS},
        )


@dataclass(frozen=True, eq=False)
class Chain:
    """The chain without a policy, as plain data that can be sent to a worker.

    Parameters
    ----------
    scenario : Scenario
    initial_velocities : (n, 2)
        V(-1).
    seed : int
    """

    scenario: Scenario
    initial_velocities: FloatArray
    seed: int

    def run(
        self,
        policy: Policy,
        first: int,
        runs: int,
        save_trajectories: int = 0,
        progress: Progress | None = None,
    ) -> Runs:
        """Sample the runs `first`, ..., `first` + `runs` - 1 under a policy.

        Parameters
        ----------
        policy : Policy
        first, runs : int
        save_trajectories : int
            Number of these runs, from the first, whose trajectories are saved.
        progress : Progress, optional
            Receives the policy's name and the number of runs that have ended, after every step.

        Raises
        ------
        PolicyError, HazardError
            Velocities or rates that are not finite or of the wrong shape.
        """
        scenario = self.scenario
        states = States(
            np.tile(scenario.positions, (runs, 1, 1)),
            np.tile(self.initial_velocities, (runs, 1, 1)),
            np.ones((runs, scenario.n), bool),
            np.ones(runs),
        )
        batch = _RunBatch(states, np.zeros(runs, np.int64), save_trajectories)
        for step in range(scenario.n_steps):
            active = np.flatnonzero(batch.running)
            if not active.size:
                break
            draws = uniforms(self.seed, step, first, runs, scenario.n)[active]
            batch.advance(scenario, policy, step, active, draws)
            if progress is not None:
                progress(policy.name, runs - int(batch.running.sum()), runs)
        return batch.outcome(first)

    def finish(self, policy: Policy, states: States, steps: IntArray) -> Runs:
        """Sample one run from each of the given states, at the given steps, to its end.

        Parameters
        ----------
        policy : Policy
        states : States
            R states; their weights are not used.
        steps : (R,) int
            The step t of each.
        """
        batch = _RunBatch(states, steps)
        for step in range(self.scenario.n_steps):
            active = np.flatnonzero(batch.running & (steps <= step))
            if active.size:
                draws = uniforms(self.seed, step, 0, len(states), self.scenario.n)[active]
                batch.advance(self.scenario, policy, step, active, draws)
        return batch.outcome(0)


class _RunBatch:
    """Runs that advance together, from given states at given steps; the states are copied."""

    def __init__(self, states: States, steps: IntArray, save_trajectories: int = 0) -> None:
        self.states = States(
            states.positions.copy(),
            states.previous_velocities.copy(),
            states.alive.copy(),
            states.weights,
        )
        self.running: BoolArray = np.ones(len(states), bool)
        self.arrival: IntArray = np.full(len(states), -1)
        self.steps = steps.copy()
        self.counts = {name: np.zeros(len(states), np.int64) for name in _DECISION_COUNTS}
        self.solved = 0
        self.recorder = TrajectoryRecorder.start(self.states, save_trajectories)

    def advance(
        self, scenario: Scenario, policy: Policy, step: int, active: IntArray, draws: FloatArray
    ) -> None:
        """Advance the active runs from `step` to step + 1; `draws` (len(active), n) are uniform."""
        states = self.states
        first, inverse = distinct_states(
            states.positions[active], states.previous_velocities[active], states.alive[active]
        )
        rows = active[first]
        alive = states.alive[rows]
        move = transition(
            scenario, policy, step, states.positions[rows], states.previous_velocities[rows], alive
        )
        survives = alive[inverse] & (draws < move.survival[inverse])
        arrived = (survives & move.inside[inverse]).any(axis=1)
        self.solved += len(rows)
        self.recorder.record_leaders(active, policy, step, states)
        for name, count in self.counts.items():
            count[active] += getattr(move, name)[inverse]
        living = survives[..., None]
        states.positions[active] = np.where(living, move.positions[inverse], 0.0)
        states.previous_velocities[active] = np.where(living, move.velocities[inverse], 0.0)
        states.alive[active] = survives
        self.steps[active] = step + 1
        self.arrival[active[arrived]] = step + 1
        self.running[active] = survives.any(axis=1) & ~arrived
        self.recorder.record_positions(active, move.positions[inverse], states.alive)

    def outcome(self, first: int) -> Runs:
        """Outcomes of the runs, once they have all ended or the horizon is reached."""
        return Runs(
            first=first,
            arrival=self.arrival,
            survivors=self.states.alive.sum(axis=1),
            steps=self.steps,
            **self.counts,
            states=self.solved,
            trajectories=self.recorder.trajectories(self.steps),
        )

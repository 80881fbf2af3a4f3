"""Monte Carlo simulation of the controlled Markov chain: all runs of a policy advance together.

A step is a `transition` and a draw of the survivors. A run ends at the first arrival of a living
member, at the last destruction, or at the horizon. Policies are deterministic, so runs in equal
states share one decision and one evaluation of rates.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, IntArray, Progress
from .lattice import Lattice
from .random_streams import Purpose, uniforms
from .states import States, distinct_states
from .trajectories import RunTrajectory, TrajectoryRecorder
from .transition import COUNTS, transition

if TYPE_CHECKING:
    from ..scenario import Scenario

_RUN_ARRAYS = ("arrival", "survivors", "steps")
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
    counts : dict of name to (R,) int
        Sums of the counts of `COUNTS` over the steps of the run.
    states : int
        Number of distinct states in which the policy was evaluated.
    seconds : float
        Time that the computation took.
    trajectories : tuple of RunTrajectory
        Trajectories of the first runs.
    """

    first: int
    arrival: IntArray
    survivors: IntArray
    steps: IntArray
    counts: dict[str, IntArray]
    states: int
    seconds: float
    trajectories: tuple[RunTrajectory, ...]

    @property
    def end(self) -> int:
        """Index after the last run."""
        return self.first + len(self.arrival)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Named arrays from which `from_arrays` restores the runs."""
        arrays = {name: np.array(getattr(self, name)) for name in ("first", "states", "seconds")}
        arrays |= {name: getattr(self, name) for name in _RUN_ARRAYS} | self.counts
        for k, trajectory in enumerate(self.trajectories):
            arrays |= {f"{name}-{k}": getattr(trajectory, name) for name in _TRAJECTORY_ARRAYS}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Runs:
        """Runs that were stored by `to_arrays`.

        Raises
        ------
        KeyError, TypeError, ValueError
            The arrays are not such.
        """
        number = sum(name.startswith("positions-") for name in arrays)
        _require_per_run([arrays[name] for name in (*_RUN_ARRAYS, *COUNTS)])
        return cls(
            first=int(arrays["first"]),
            counts={name: arrays[name] for name in COUNTS},
            states=int(arrays["states"]),
            seconds=float(arrays["seconds"]),
            trajectories=tuple(
                RunTrajectory(*(arrays[f"{name}-{k}"] for name in _TRAJECTORY_ARRAYS))
                for k in range(number)
            ),
            **{name: arrays[name] for name in _RUN_ARRAYS},
        )


def _require_per_run(arrays: Sequence[NDArray[Any]]) -> None:
    """Raise ValueError unless the arrays have a whole number for every run."""
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1 or arrays[0].ndim != 1 or any(a.dtype.kind != "i" for a in arrays):
        raise ValueError("the arrays do not have a whole number for every run")


@dataclass(frozen=True, eq=False)
class Chain:
    """The chain without a policy, as plain data that can be sent to a worker.

    Parameters
    ----------
    scenario : Scenario
    initial_velocities : (n, 2)
        V(-1).
    seed : int
    purpose : Purpose
        What its random numbers are for.
    lattice : Lattice, optional
        Lattice of the positions.
    """

    scenario: Scenario
    initial_velocities: FloatArray
    seed: int
    purpose: Purpose = Purpose.RUNS
    lattice: Lattice | None = None

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
        states = States.initial(self.scenario, self.initial_velocities, runs)
        batch = _RunBatch(states, np.zeros(runs, np.int64), save_trajectories)
        return batch.finish(self, policy, first, progress)

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
        return _RunBatch(states, steps).finish(self, policy)


class _RunBatch:
    """Runs that advance together, from given states at given steps."""

    def __init__(self, states: States, steps: IntArray, save_trajectories: int = 0) -> None:
        self.started = time.perf_counter()
        self.states, self.steps = deepcopy(states), steps.copy()
        self.running: BoolArray = np.ones(len(states), bool)
        self.arrival: IntArray = np.full(len(states), -1)
        self.counts = {name: np.zeros(len(states), np.int64) for name in COUNTS}
        self.solved = 0
        self.recorder = TrajectoryRecorder(states, save_trajectories)

    def finish(
        self, chain: Chain, policy: Policy, first: int = 0, progress: Progress | None = None
    ) -> Runs:
        """Advance all runs to their ends; `first` is the index of the first one."""
        scenario, runs = chain.scenario, len(self.states)
        for step in range(scenario.n_steps):
            active = np.flatnonzero(self.running & (self.steps <= step))
            if not active.size:
                continue
            draws = uniforms(chain.seed, step, first, runs, scenario.n, chain.purpose)
            self.advance(chain, policy, step, active, draws[active])
            if progress is not None:
                progress(policy.name, runs - int(self.running.sum()), runs)
        return Runs(
            first=first,
            arrival=self.arrival,
            survivors=self.states.alive.sum(axis=1),
            steps=self.steps,
            counts=self.counts,
            states=self.solved,
            seconds=time.perf_counter() - self.started,
            trajectories=self.recorder.trajectories(self.steps),
        )

    def advance(
        self, chain: Chain, policy: Policy, step: int, active: IntArray, draws: FloatArray
    ) -> None:
        """Advance the active runs from `step` to step + 1; `draws` (len(active), n) are uniform."""
        states, before = self.states, self.states[active]
        first, inverse = distinct_states(before.positions, before.previous_velocities, before.alive)
        move = transition(chain.scenario, policy, step, before[first], chain.lattice)
        following = move.positions[inverse]
        survives = before.alive & (draws < move.survival[inverse])
        arrived = (survives & move.inside[inverse]).any(axis=1)
        self.solved += len(first)
        for name, count in move.counts.items():
            self.counts[name][active] += count[inverse]
        living = survives[..., None]
        states.positions[active] = np.where(living, following, 0.0)
        states.previous_velocities[active] = np.where(living, move.velocities[inverse], 0.0)
        states.alive[active] = survives
        self.steps[active] = step + 1
        self.arrival[active[arrived]] = step + 1
        self.running[active] = survives.any(axis=1) & ~arrived
        self.recorder.record(policy, step, active, before, following, states.alive)

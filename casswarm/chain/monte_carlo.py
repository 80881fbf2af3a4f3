"""Monte Carlo simulation of the controlled Markov chain: streams, trajectories, outcomes.

A step is a `transition` and a draw of the survivors. A run ends when as many living members as
``success.arrivals`` says are in the target, at the last destruction, or at the horizon. Policies
are deterministic, so runs in equal states share one decision and one evaluation of rates: a run is
a row of a table of distinct states.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import kernel
from ..policies.base import Policy, policy_call
from ..typing import BoolArray, FloatArray, IntArray, Progress
from .states import States, distinct_survivors
from .transition import COUNTS, Lattice, transition

if TYPE_CHECKING:
    from ..scenario import Scenario


_WORDS = 4  # numbers a Philox counter yields
STEP_BITS = 56  # of the word of the key that holds purpose and step

# Philox-4x64-10 as in Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3",
# SC11, 2011, section 3.3, with the counter and the conversion to doubles of NumPy's Philox
_MULTIPLIERS = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_WEYL = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_LOW, _HALF, _DISCARDED = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(11)
_ROUNDS = 10
_UNIT = 2.0**-53


class Purpose(IntEnum):
    """Purpose of random numbers: every purpose has streams of its own."""

    RUNS = 0
    PILOT = 1
    STRATA = 2
    CASES = 3
    PREDICTION = 4


def uniforms(
    seed: int, step: int, first: int, runs: int, members: int, purpose: Purpose = Purpose.RUNS
) -> FloatArray:
    """Uniform numbers in [0, 1) of a step, for the runs `first`, ..., `first` + `runs` - 1.

    A counter-based generator (Philox-4x64) whose key is the seed in one word, and the purpose and
    the step in the other, with a fixed block of counters for every run. Different (seed, purpose,
    step) are different keys, so no two streams are the same. A number depends only on the seed, the
    purpose, the step, the run, the member and the number of members: it is the same under every
    policy (common random numbers), for every horizon, in every batch, on every worker.

    Parameters
    ----------
    seed : int
        From 0 to 2^64 - 1.
    step : int
        From 0 to 2^56 - 1.
    first, runs : int
    members : int
    purpose : Purpose

    Returns
    -------
    ndarray, shape (runs, members)
    """
    blocks = -(-members // _WORDS)
    key = np.array([seed, purpose << STEP_BITS | step], np.uint64)
    generator = np.random.Generator(np.random.Philox(key=key, counter=first * blocks))
    return generator.random((runs, blocks * _WORDS))[:, :members]


@kernel
def high_product(a: Any, b: Any) -> Any:
    """The upper 64 bits of the product of two unsigned 64-bit integers."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    middle = a_high * b_low + (a_low * b_low >> _HALF)
    other = a_low * b_high + (middle & _LOW)
    return a_high * b_high + (middle >> _HALF) + (other >> _HALF)


@kernel
def write_uniforms(seed: Any, purpose_and_step: Any, run: Any, draws: FloatArray) -> None:
    """Write the uniform numbers (n,) of a run's members, equal to those of `uniforms`.

    All integers are unsigned; `purpose_and_step` is the second word of the generator's key.
    """
    blocks = np.uint64((draws.size + 3) // 4)
    for block in range(blocks):
        # the generator counts up before it draws
        c0, c1 = run * blocks + np.uint64(block) + np.uint64(1), np.uint64(0)
        c2, c3, k0, k1 = np.uint64(0), np.uint64(0), seed, purpose_and_step
        for _ in range(_ROUNDS):
            h0, h1 = high_product(_MULTIPLIERS[0], c0), high_product(_MULTIPLIERS[1], c2)
            low0, low1 = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
            c0, c1, c2, c3 = h1 ^ c1 ^ k0, low1, h0 ^ c3 ^ k1, low0
            k0, k1 = k0 + _WEYL[0], k1 + _WEYL[1]
        first = 4 * block
        for word in range(min(4, draws.size - first)):
            bits = c0
            if word == 1:
                bits = c1
            elif word == 2:
                bits = c2
            elif word == 3:
                bits = c3
            draws[first + word] = (bits >> _DISCARDED) * _UNIT


@dataclass(frozen=True, eq=False)
class RunTrajectory:
    """Trajectory of one run.

    Parameters
    ----------
    positions : (T+1, n, 2)
        Positions X(0..T); the destroyed stay where they were destroyed, and ghosts when their loss
        became known.
    alive : (T+1, n) bool
    leaders : (T,) int
        Index of the leader from step t to t + 1, -1 where the policy has no leader.
    believed : (T+1, n) bool, optional
        Members that are not known to be lost; those alive if losses are known at once.
    case : int, optional
        The true case of a hazard that is not known.
    """

    positions: FloatArray
    alive: BoolArray
    leaders: IntArray
    believed: BoolArray | None = None
    case: int | None = None

    @property
    def ghosts(self) -> BoolArray:
        """Members (T+1, n) that are lost and not known to be."""
        return (self.alive if self.believed is None else self.believed) & ~self.alive

    def last_steps(self) -> IntArray:
        """Step (n,) at which every member was destroyed, or the last step."""
        return _last_steps(self.alive)

    def ghost_paths(self) -> list[FloatArray]:
        """Positions (T_i, 2) of every member from its loss until that is known."""
        ends = zip(self.last_steps(), _last_steps(self.alive | self.ghosts), strict=True)
        return [self.positions[start : end + 1, i] for i, (start, end) in enumerate(ends)]


def _last_steps(mask: BoolArray) -> IntArray:
    """Step (n,) at which a mask (T+1, n) that only falls becomes False, or the last one."""
    return np.where(mask[-1], len(mask) - 1, np.argmin(mask, axis=0))


class TrajectoryRecorder:
    """Snapshots of runs at every step, from their initial states (R)."""

    def __init__(self, states: States) -> None:
        self.runs = len(states)
        self.positions, self.alive = [states.positions], [states.alive]
        self.believed = None if states.late is None else [states.believed]
        self.case = states.case
        self.leaders: list[IntArray] = []

    def record(
        self,
        policy: Policy,
        step: int,
        rows: IntArray,
        states: States,
        following: FloatArray,
        after: tuple[BoolArray, BoolArray],
    ) -> None:
        """Append a step: of the runs `rows`, their states before it, and what follows.

        `after` are the members then alive, and those not known to be lost. Others stay where they
        are, and so do all members of other runs.
        """
        positions, survivors = self.positions[-1].copy(), self.alive[-1].copy()
        leaders = np.full(self.runs, -1)
        if rows.size:
            given = policy if states.belief is None else policy.given(states.belief)
            with policy_call(policy.name, step):
                leaders[rows] = given.leaders(
                    step, states.positions, states.previous_velocities, states.believed
                )
        positions[rows] = np.where(states.believed[..., None], following, positions[rows])
        survivors[rows] = after[0]
        if self.believed is not None:
            self.believed.append(self.believed[-1].copy())
            self.believed[-1][rows] = after[1]
        self.positions.append(positions)
        self.alive.append(survivors)
        self.leaders.append(leaders)

    def trajectories(self, steps: IntArray) -> tuple[RunTrajectory, ...]:
        """Trajectories up to the steps (R,) at which runs ended."""
        positions, alive = np.stack(self.positions, axis=1), np.stack(self.alive, axis=1)
        leaders = np.array(self.leaders, np.int64).reshape(len(self.leaders), self.runs).T
        believed = None if self.believed is None else np.stack(self.believed, axis=1)
        return tuple(
            RunTrajectory(
                positions[k, : end + 1],
                alive[k, : end + 1],
                leaders[k, :end],
                None if believed is None else believed[k, : end + 1],
                None if self.case is None else int(self.case[k]),
            )
            for k, end in enumerate(steps[: self.runs])
        )


_RUN_ARRAYS = ("arrival", "survivors", "steps", "case")
_TRAJECTORY_ARRAYS = ("positions", "alive", "leaders")


@dataclass(frozen=True, eq=False)
class Runs:
    """Outcomes of R runs, an entry each."""

    first: int  # index of the first run
    arrival: IntArray  # (R,) step of the first arrival of a living member, -1 where there is none
    survivors: IntArray  # (R,) members alive at the end of the run
    steps: IntArray  # (R,) length of the run
    distance: FloatArray  # (R,) of the nearest living member from the target zone, or NaN
    counts: dict[str, IntArray]  # (R,) sums of the counts of `COUNTS` over the steps of the run
    states: int  # number of distinct states in which the policy was evaluated
    seconds: float  # time that the computation took
    trajectories: tuple[RunTrajectory, ...]  # of the first runs
    case: IntArray  # (R,) true case of the hazard; 0 if it is known

    @property
    def end(self) -> int:
        """Index after the last run."""
        return self.first + len(self.arrival)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Named arrays from which `from_arrays` restores the runs."""
        arrays = {name: np.array(getattr(self, name)) for name in ("first", "states", "seconds")}
        arrays |= {name: getattr(self, name) for name in (*_RUN_ARRAYS, "distance")} | self.counts
        for k, trajectory in enumerate(self.trajectories):
            arrays |= {f"{name}-{k}": getattr(trajectory, name) for name in _TRAJECTORY_ARRAYS}
            if trajectory.believed is not None:
                arrays[f"believed-{k}"] = trajectory.believed
            if trajectory.case is not None:
                arrays[f"case-{k}"] = np.array(trajectory.case)
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
        if arrays["distance"].shape != arrays["arrival"].shape:
            raise ValueError("the arrays do not have a distance for every run")
        return cls(
            first=int(arrays["first"]),
            distance=arrays["distance"].astype(float),
            counts={name: arrays[name] for name in COUNTS},
            states=int(arrays["states"]),
            seconds=float(arrays["seconds"]),
            trajectories=tuple(
                RunTrajectory(
                    **{name: arrays[f"{name}-{k}"] for name in _TRAJECTORY_ARRAYS},
                    believed=arrays.get(f"believed-{k}"),
                    case=int(arrays[f"case-{k}"]) if f"case-{k}" in arrays else None,
                )
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
        initial = States.initial(self.scenario, self.initial_velocities, weighs=policy.weighs_cases)
        starts = np.zeros((2, runs), np.int64)
        starts[0] = self.true_cases(first, runs)
        batch = RunBatch(initial, starts, save_trajectories)
        return batch.finish(self, policy, first, progress)

    def true_cases(self, first: int, runs: int) -> IntArray:
        """True case (R,) of the hazard in every run, drawn by the prior; 0 if it is known."""
        draws = uniforms(self.seed, self.purpose, first, runs, 1, Purpose.CASES)[:, 0]
        return drawn_cases(self.scenario, draws)

    def finish(
        self,
        policy: Policy,
        states: States,
        steps: IntArray,
        progress: Progress | None = None,
    ) -> Runs:
        """Sample one run from each of the given states, at the given steps, to its end.

        Parameters
        ----------
        policy : Policy
        states : States
            R states; their weights are not used.
        steps : (R,) int
            The step t of each.
        progress : Progress, optional
            As in `run`.
        """
        batch = RunBatch(states, np.stack([np.arange(len(states)), steps]))
        return batch.finish(self, policy, progress=progress)


def drawn_cases(scenario: Scenario, draws: FloatArray) -> IntArray:
    """Cases (R,) of the hazard for uniform numbers in [0, 1)."""
    ends = np.cumsum([case.weight for case in scenario.cases])[:-1]
    return np.searchsorted(ends, draws, side="right")


def _outside(scenario: Scenario, positions: FloatArray, alive: BoolArray) -> FloatArray:
    """Distances (S,) from the target zone of the nearest living members that count; NaN if none."""
    counting = scenario.swarm.counted(alive)
    outside = np.where(counting, scenario.target.outside(positions), np.inf)
    nearest = outside.min(axis=1)
    return np.where(np.isfinite(nearest), nearest, np.nan)


class RunBatch:
    """Runs that advance together, each from a row of `initial` and a step: `starts` (2, R)."""

    def __init__(self, initial: States, starts: IntArray, save_trajectories: int = 0) -> None:
        self.started = time.perf_counter()
        self.initial, (self.rows, self.starts) = initial, starts
        self.table, self.row = initial[:0], self.rows.copy()
        """Distinct states of the running runs, and the row of each run among them."""
        self.running: BoolArray = np.zeros(len(self.rows), bool)
        self.steps = self.starts.copy()
        self.arrival: IntArray = np.full(len(self.rows), -1)
        self.survivors = initial.alive.sum(axis=1)[self.rows]
        self.distance = np.full(len(self.rows), np.nan)
        self.counts = {name: np.zeros(len(self.rows), np.int64) for name in COUNTS}
        self.solved = 0
        self.recorder = TrajectoryRecorder(initial[self.rows[:save_trajectories]])

    def finish(
        self, chain: Chain, policy: Policy, first: int = 0, progress: Progress | None = None
    ) -> Runs:
        """Advance all runs to their ends; `first` is the index of the first one."""
        scenario, runs, cases = chain.scenario, len(self.rows), self.initial.case
        for step in range(scenario.n_steps):
            self.begin(step)
            if not self.running.any():
                continue
            draws = uniforms(chain.seed, step, first, runs, scenario.n, chain.purpose)
            self.advance(chain, policy, step, draws)
            if progress is not None:
                ended = (self.starts <= step) & ~self.running
                progress(policy.name, int(ended.sum()), runs)
        return Runs(
            first=first,
            arrival=self.arrival,
            survivors=self.survivors,
            steps=self.steps,
            distance=self.distance,
            counts=self.counts,
            states=self.solved,
            seconds=time.perf_counter() - self.started,
            trajectories=self.recorder.trajectories(self.steps),
            case=np.zeros_like(self.rows) if cases is None else cases[self.rows],
        )

    def begin(self, step: int) -> None:
        """Add the runs that start at a step."""
        starting = np.flatnonzero(self.starts == step)
        if starting.size:
            used, inverse = np.unique(self.rows[starting], return_inverse=True)
            self.row[starting] = len(self.table) + inverse
            self.running[starting] = True
            self.set_table(States.concatenate([self.table, self.initial[used]]))

    def set_table(self, table: States) -> None:
        """Identify equal states of a table, in which `row` is the place of the running runs."""
        self.table, inverse = table.aggregated()
        self.row[self.running] = inverse[self.row[self.running]]

    def advance(self, chain: Chain, policy: Policy, step: int, draws: FloatArray) -> None:
        """Advance the running runs from `step` to step + 1; `draws` (R, n) are uniform."""
        active = np.flatnonzero(self.running)
        rows = self.row[active]
        move = transition(chain.scenario, policy, step, self.table, chain.lattice)
        self.solved += len(self.table)
        for name, count in move.counts.items():
            if count.any():
                self.counts[name][active] += count[rows]
        survival = np.where(self.table.alive, move.survival, 0.0)
        first, child = distinct_survivors(active, rows, draws, survival)
        parent = rows[first]
        alive = draws[active[first]] < survival[parent]  # of the distinct states that follow
        arrived = (alive & move.inside[parent]).sum(axis=1) >= move.arrivals
        saved = active[active < self.recorder.runs]
        own, survivors = rows[: len(saved)], alive[child[: len(saved)]]
        after = survivors, move.believed(own, survivors)
        self.recorder.record(policy, step, saved, self.table[own], move.positions[own], after)
        self.steps[active] = step + 1
        self.survivors[active] = alive.sum(axis=1)[child]
        self.arrival[active[arrived[child]]] = step + 1
        if step + 1 == chain.scenario.n_steps:
            self.distance[active] = _outside(chain.scenario, move.positions[parent], alive)[child]
        self.distance[active[arrived[child]]] = 0.0
        runs_on = alive.any(axis=1) & ~arrived
        self.running[active] = runs_on[child]
        self.row[active] = (np.cumsum(runs_on) - 1)[child]
        weights = self.weights(parent[runs_on], alive[runs_on], survival)
        self.set_table(move.following(parent[runs_on], alive[runs_on], weights))

    def weights(self, parents: IntArray, alive: BoolArray, survival: FloatArray) -> FloatArray:  # noqa: ARG002
        """Weights of the states (K,) that follow from rows of the table."""
        return np.ones(len(parents))

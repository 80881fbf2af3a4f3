"""The controlled Markov chain, exactly: the law of a policy without sampling.

Policies are deterministic, so between two destructions nothing is random. The law is a set of
distinct states (positions, previous velocities, who is alive) with probabilities. A step solves
every state once and splits it by who survives; equal states are merged; the lightest states, up to
a stated mass, are set aside. What is set aside may have succeeded or not, so every probability is
a bracket [low, low + set aside] and no estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Booleans, Counts, Floats
from ..policies.base import Policy
from .transition import distinct_states, transition

if TYPE_CHECKING:
    from ..scenario import Scenario

MOST_MEMBERS = 12
"""Members up to which the 2^n outcomes of a step are enumerated."""

_CHUNK = 1 << 20  # state-outcome pairs split at once: bounds memory


@dataclass(frozen=True, eq=False)
class Law:
    """The law of the chain under a policy.

    Every probability is known up to `unresolved`: the true one lies between the number given and
    that number plus `unresolved`.

    Parameters
    ----------
    policy : str
    arrival : (N+1,)
        Probability that the first arrival of a living member is at step t.
    survivors : (n+1,)
        Probability that k members are alive at the end of the run (arrival, last destruction or
        horizon).
    members : (n,)
        Probability that a member is alive at the end of the run.
    unresolved : float
        Mass of the states that were set aside.
    states : int
        Distinct states that were solved.
    shortfalls, failures : float
        Expected numbers of member-steps with a shortfall and of solver failures in a run, up to
        what was set aside.
    """

    policy: str
    arrival: Floats
    survivors: Floats
    members: Floats
    unresolved: float
    states: int
    shortfalls: float
    failures: float

    @property
    def success(self) -> tuple[float, float]:
        """Bracket of the probability that some member arrives alive."""
        low = float(self.arrival.sum())
        return low, min(1.0, low + self.unresolved)

    @property
    def survivors_mean(self) -> tuple[float, float]:
        """Bracket of the mean number of members alive at the end of a run."""
        low = float(self.members.sum())
        return low, low + self.unresolved * len(self.members)

    def __str__(self) -> str:
        low, high = self.success
        return (
            f"{self.policy}: success between {low:.6f} and {high:.6f}, "
            f"{self.states} distinct states solved"
        )


def propagate(
    scenario: Scenario,
    policy: Policy,
    before: Floats,
    tolerance: float,
    most_states: int,
    progress: Callable[[int, int], None] | None = None,
) -> Law:
    """The law of the chain, breadth first.

    Parameters
    ----------
    scenario : Scenario
        Of at most `MOST_MEMBERS` members.
    policy : Policy
    before : (n, 2)
        V(-1).
    tolerance : float
        Mass that may be set aside, in equal parts over the steps.
    most_states : int
        States kept at a step at the most; the lightest beyond are set aside too.
    progress : callable, optional
        Called after every step with the step and the number of states that it solved.
    """
    mass = _Mass.start(scenario, before)
    totals = _Totals.empty(scenario)
    for step in range(scenario.n_steps):
        if not mass.weights.size:
            break
        solved = mass.weights.size
        mass = _advance(scenario, policy, step, mass, totals)
        mass, set_aside = mass.merged().pruned(tolerance / scenario.n_steps, most_states)
        totals.unresolved += set_aside
        totals.states += solved
        if progress is not None:
            progress(step + 1, solved)
    totals.end(mass.alive, mass.weights)  # alive at the horizon, not arrived
    return Law(
        policy=policy.name,
        arrival=totals.arrival,
        survivors=totals.survivors,
        members=totals.members,
        unresolved=totals.unresolved,
        states=totals.states,
        shortfalls=totals.shortfalls,
        failures=totals.failures,
    )


@dataclass(frozen=True, eq=False)
class _Mass:
    """S distinct states and their probabilities; the entries of the destroyed are zero."""

    positions: Floats
    previous: Floats
    alive: Booleans
    weights: Floats

    @classmethod
    def start(cls, scenario: Scenario, before: Floats) -> _Mass:
        alive = np.ones((1, scenario.n), bool)
        return cls(scenario.positions[None].copy(), before[None].copy(), alive, np.ones(1))

    def __getitem__(self, rows: Counts | slice) -> _Mass:
        return _Mass(
            self.positions[rows], self.previous[rows], self.alive[rows], self.weights[rows]
        )

    def merged(self) -> _Mass:
        """Equal states as one."""
        first, back = distinct_states(self.positions, self.previous, self.alive)
        weights = np.bincount(back, self.weights, len(first)).astype(np.float64)
        return _Mass(self.positions[first], self.previous[first], self.alive[first], weights)

    def pruned(self, allowed: float, most: int) -> tuple[_Mass, float]:
        """Without the lightest states, up to the mass `allowed`, and at most `most` of them."""
        order = np.argsort(self.weights, kind="stable")
        lighter = int(np.searchsorted(np.cumsum(self.weights[order]), allowed, side="right"))
        cut = max(lighter, len(order) - most)
        return self[np.sort(order[cut:])], float(self.weights[order[:cut]].sum())


@dataclass
class _Totals:
    arrival: Floats
    survivors: Floats
    members: Floats
    unresolved: float = 0.0
    states: int = 0
    shortfalls: float = 0.0
    failures: float = 0.0

    @classmethod
    def empty(cls, scenario: Scenario) -> _Totals:
        n = scenario.n
        return cls(np.zeros(scenario.n_steps + 1), np.zeros(n + 1), np.zeros(n))

    def end(self, alive: Booleans, weights: Floats) -> None:
        """Count runs that end with these members alive."""
        self.survivors += np.bincount(alive.sum(axis=1), weights, minlength=len(self.survivors))
        self.members += weights @ alive


def _advance(scenario: Scenario, policy: Policy, step: int, mass: _Mass, totals: _Totals) -> _Mass:
    """The states after a step; runs that end are counted in `totals`."""
    move = transition(scenario, policy, step, mass.positions, mass.previous, mass.alive)
    totals.shortfalls += float(mass.weights @ move.shortfalls)
    totals.failures += float(mass.weights @ move.failures)

    outcomes = _outcomes(scenario.n)
    size = max(1, _CHUNK // len(outcomes))
    parts = []
    for start in range(0, len(move.positions), size):
        rows = slice(start, start + size)
        alive = mass.alive[rows]
        states, fates = np.nonzero(~(outcomes[None] & ~alive[:, None]).any(axis=2))
        after = outcomes[fates]
        factors = np.where(after, move.survival[rows][states], 1.0 - move.survival[rows][states])
        weights = mass.weights[rows][states] * np.where(alive[states], factors, 1.0).prod(axis=1)
        arrived = (after & move.inside[rows][states]).any(axis=1)
        ended = arrived | ~after.any(axis=1)
        totals.arrival[step + 1] += weights[arrived].sum()
        totals.end(after[ended], weights[ended])
        left = ~ended & (weights > 0.0)
        kept, origin = after[left], states[left]
        parts.append(
            _Mass(
                np.where(kept[..., None], move.positions[rows][origin], 0.0),
                np.where(kept[..., None], move.velocities[rows][origin], 0.0),
                kept,
                weights[left],
            ).merged()
        )
    return _Mass(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.previous for part in parts]),
        np.concatenate([part.alive for part in parts]),
        np.concatenate([part.weights for part in parts]),
    )


def _outcomes(n: int) -> Booleans:
    """All 2^n sets of survivors, (2^n, n)."""
    return np.asarray((np.arange(1 << n)[:, None] >> np.arange(n)) & 1 == 1)

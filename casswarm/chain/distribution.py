"""Answers about the chain under a policy: proven bounds, and estimates that are sampled in part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .._util.display import Displayed
from ..typing import FloatArray, Interval
from .confidence import LEVEL, stratified_interval

_LINEAR = (
    "arrival",
    "survivors",
    "members",
    "population",
    "residual_mass_before",
    "residual_mass",
    "infeasible",
    "failures",
)
"""Values of a distribution that are means over the cases of a hazard that is not known."""


class Band(NamedTuple):
    """Lower and upper bounds at every step.

    Parameters
    ----------
    low, high : (N+1,)
    """

    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class OutcomeDistribution(Displayed):
    """Distribution of the outcomes of a run under a policy.

    Every probability is a lower bound, and the exact value exceeds it by at most `residual_mass`.
    With `aggregation_tol` above zero the policy is the one whose commands are rounded to a lattice
    of that spacing, see `casswarm.evaluate`; at zero its commands are executed as they are.

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
    population : (N+1, n+1)
        Probability that k members are alive at step t, or at the end of a run that ended before.
    residual_mass_before : (N+1,)
        Mass left unexpanded before step t: `arrival` and `population` are known up to it.
    residual_mass : float
        Mass of all states that were not expanded, over all steps.
    states : int
        Number of distinct states in which the policy was evaluated.
    infeasible, failures : float
        Expected numbers of infeasible member-steps and of solver failures in a run, up to the
        residual mass.
    tolerance : float
        Requested upper limit of `residual_mass`.
    aggregation_tol : float
        Spacing of the lattice of positions; 0 without a lattice.
    cases : tuple of (weight, OutcomeDistribution)
        Of a hazard that is not known: the prior weight of every case, and the distribution if it
        is the true one. All other values are then those of the prior. Empty if it is known.
    """

    policy: str
    arrival: FloatArray
    survivors: FloatArray
    members: FloatArray
    population: FloatArray
    residual_mass_before: FloatArray
    residual_mass: float
    states: int
    infeasible: float
    failures: float
    tolerance: float
    aggregation_tol: float
    cases: tuple[tuple[float, OutcomeDistribution], ...] = ()

    @classmethod
    def of_cases(cls, cases: Sequence[tuple[float, OutcomeDistribution]]) -> OutcomeDistribution:
        """The distribution for a prior over cases, the mean of theirs; of one case, its own."""
        first = cases[0][1]
        if len(cases) == 1:
            return first
        means = {
            name: sum(weight * getattr(each, name) for weight, each in cases) for name in _LINEAR
        }
        states = sum(each.states for _, each in cases)
        return replace(first, **means, states=states, cases=tuple(cases))

    @property
    def success(self) -> Interval:
        """Bounds of the probability that at least one member arrives alive."""
        low = float(self.arrival.sum())
        return Interval(low, min(1.0, low + self.residual_mass))

    @property
    def survivors_mean(self) -> Interval:
        """Bounds of the expected number of members alive at the end of a run."""
        low = float(self.members.sum())
        return Interval(low, low + self.residual_mass * len(self.members))

    @property
    def complete(self) -> bool:
        """True if the bounds are as narrow as requested."""
        return self.residual_mass <= self.tolerance

    @property
    def population_mean(self) -> Band:
        """Bounds of the expected number of living members at every step; it never increases."""
        low = self.population @ np.arange(self.population.shape[1])
        high = low + self.residual_mass_before * (self.population.shape[1] - 1)
        return Band(low, np.minimum.accumulate(high))

    @property
    def any_alive(self) -> Band:
        """Bounds of the probability that at least one member is alive, at every step."""
        low = self.population[:, 1:].sum(axis=1)
        high = np.minimum(1.0, low + self.residual_mass_before)
        return Band(low, np.minimum.accumulate(high))

    def __repr__(self) -> str:
        low, high = self.success
        return (
            f"OutcomeDistribution({self.policy!r}, success=[{low:.6f}, {high:.6f}], "
            f"states={self.states})"
        )

    def __str__(self) -> str:
        low, high = self.success
        rounded = f", motion rounded to {self.aggregation_tol:.2g}" if self.aggregation_tol else ""
        text = (
            f"{self.policy}: success between {low:.6f} and {high:.6f}, "
            f"{self.states} distinct states solved{rounded}"
        )
        if self.cases:
            text += (
                f"; by case {', '.join(f'{each.success.midpoint:.4f}' for _, each in self.cases)}"
            )
        return text if self.complete else f"{text}; {self.advice}"

    @property
    def advice(self) -> str:
        """Advice on narrowing bounds that are wider than requested; empty if they are not."""
        if self.complete:
            return ""
        return (
            f"state budget exhausted before a width of {self.tolerance:g} was reached: allow more "
            "states (--max-states, max_states=) or memory (--memory, memory=), sample the residual "
            "mass (--runs, csw.estimate), or round the motion to a coarser lattice "
            "(--aggregation-tol, aggregation_tol=)"
        )


@dataclass(frozen=True)
class Estimate:
    """Success probability of which one part is proven and the other statistical.

    Parameters
    ----------
    enumerated : OutcomeDistribution
        The proven part: its bounds hold with certainty.
    sampled_mass : float
        Mass of the states that were sampled.
    pruned_mass : float
        Mass that was neither enumerated nor sampled; it widens the interval.
    runs, successes : int
        Numbers of sampled runs, and of those that succeeded.
    effective_runs : float
        Number of independent runs with the same variance, at least `runs`.
    seed : int
    states : int
        Distinct states solved, enumerated or sampled.
    level : float
        Confidence level of the interval.
    cases : tuple of (weight, Estimate)
        Of a hazard that is not known: the prior weight of every case, and the estimate if it is the
        true one. All other values are then those of the prior. Empty if it is known.
    """

    enumerated: OutcomeDistribution
    sampled_mass: float
    pruned_mass: float
    runs: int
    successes: int
    effective_runs: float
    seed: int
    states: int
    level: float = LEVEL
    cases: tuple[tuple[float, Estimate], ...] = ()

    @classmethod
    def of_cases(cls, cases: Sequence[tuple[float, Estimate]]) -> Estimate:
        """The estimate for a prior over cases; of one case, its own."""
        first = cases[0][1]
        if len(cases) == 1:
            return first
        enumerated = OutcomeDistribution.of_cases([(w, each.enumerated) for w, each in cases])
        means = {
            name: sum(weight * getattr(each, name) for weight, each in cases)
            for name in ("sampled_mass", "pruned_mass")
        }
        sums = {
            name: sum(getattr(each, name) for _, each in cases)
            for name in ("runs", "successes", "effective_runs", "states")
        }
        return replace(first, enumerated=enumerated, **means, **sums, cases=tuple(cases))

    @property
    def success(self) -> Interval:
        """Interval of the success probability, of confidence `level`.

        Over K cases, the mean of their intervals of confidence 1 - (1 - `level`) / K.
        """
        if self.cases:
            level = 1.0 - (1.0 - self.level) / len(self.cases)
            intervals = [(w, replace(each, level=level).success) for w, each in self.cases]
            return Interval(*(sum(w * each[end] for w, each in intervals) for end in (0, 1)))
        low, high = self.enumerated.success
        if not self.runs:
            return Interval(low, high)
        bottom, top = stratified_interval(
            self.successes, self.runs, self.effective_runs, self.level
        )
        top = low + self.sampled_mass * top + self.pruned_mass
        return Interval(low + self.sampled_mass * bottom, min(1.0, top))

    @property
    def policy(self) -> str:
        """Name of the policy."""
        return self.enumerated.policy

    def __str__(self) -> str:
        low, high = self.success
        first, last = self.enumerated.success
        return (
            f"{self.policy}: success between {low:.6f} and {high:.6f} with {self.level:.0%} "
            f"confidence; proven bounds: {first:.6f} to {last:.6f}; residual mass "
            f"{self.sampled_mass:.4g} sampled by {self.runs} runs, {self.states} distinct states "
            "solved"
        )

"""The law of the chain under a policy, as brackets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..typing import FloatArray


@dataclass(frozen=True, eq=False)
class OutcomeDistribution:
    """The law of the chain under a policy.

    Every probability is known up to `unresolved`: the true one lies between the number given and
    that number plus `unresolved`. With `aggregation_tol` above zero that holds for the chain in which
    states nearer than `aggregation_tol` are one; at zero it holds for the chain itself.

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
    unknown : (N+1,)
        Mass set aside before step t: `arrival` and `population` are known up to it.
    unresolved : float
        Mass of the states that were set aside, over all steps.
    states : int
        Distinct states that were solved.
    infeasible, failures : float
        Expected numbers of member-steps with a shortfall and of solver failures in a run, up to
        what was set aside.
    tolerance : float
        What `unresolved` was to be at the most.
    aggregation_tol : float
        Width of the grid in a cell of which two states counted as equal.
    """

    policy: str
    arrival: FloatArray
    survivors: FloatArray
    members: FloatArray
    population: FloatArray
    unknown: FloatArray
    unresolved: float
    states: int
    infeasible: float
    failures: float
    tolerance: float
    aggregation_tol: float

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

    @property
    def complete(self) -> bool:
        """Whether the bracket is as narrow as was asked for."""
        return self.unresolved <= self.tolerance

    @property
    def proven(self) -> bool:
        """Whether no states but equal ones were merged, so that the brackets are the chain's."""
        return self.aggregation_tol == 0.0

    @property
    def population_mean(self) -> tuple[FloatArray, FloatArray]:
        """Brackets (N+1,) of the mean number of members alive at every step; nobody comes back."""
        low = self.population @ np.arange(self.population.shape[1])
        high = low + self.unknown * (self.population.shape[1] - 1)
        return low, np.minimum.accumulate(high)

    @property
    def anybody(self) -> tuple[FloatArray, FloatArray]:
        """Brackets (N+1,) of the probability that somebody is alive at every step."""
        low = self.population[:, 1:].sum(axis=1)
        return low, np.minimum.accumulate(np.minimum(1.0, low + self.unknown))

    def __str__(self) -> str:
        low, high = self.success
        merged = (
            "" if self.proven else f", states within {self.aggregation_tol:g} of each other merged"
        )
        text = (
            f"{self.policy}: success between {low:.6f} and {high:.6f}, "
            f"{self.states} distinct states solved{merged}"
        )
        return text if self.complete else f"{text}; {self.help}"

    @property
    def help(self) -> str:
        """What would narrow a bracket that is wider than was asked for."""
        if self.complete:
            return ""
        text = (
            f"wider than {self.tolerance:g}, the states ran out: allow more of them "
            "(--max-states, max_states=), sample the rest (--runs, cs.estimate)"
        )
        more = ", or merge nearly equal states (--aggregation-tol 1e-6, merging=)"
        return text + more if self.proven else text

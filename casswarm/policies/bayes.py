"""Formation policies that weigh the cases of an unknown hazard by who has survived so far."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from ..scenario.variations import require_default
from ..typing import BoolArray, FloatArray, IntArray
from .base import SOLVER_TOL, Decision, Policy
from .formation_policies import FeedbackPolicy, FormationPolicy

if TYPE_CHECKING:
    from ..scenario import Scenario


@dataclass(frozen=True, eq=False)
class BayesPolicy(Policy):
    """A formation policy whose rates are means by the posterior of the cases.

    The guide, and the value function of feedback policies, remain those of the prior. The posterior
    is part of the state of the chain (`casswarm.chain.belief`), which asks `given` for decisions;
    without it the policy decides by the prior.

    Parameters
    ----------
    scenario : Scenario
        With several cases.
    prior : FormationPolicy or FeedbackPolicy
        The policy by the prior.
    """

    scenario: Scenario
    prior: FormationPolicy | FeedbackPolicy
    decision_tol: ClassVar[float] = SOLVER_TOL
    weighs_cases: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_default(self.scenario, "information.delay", "formation.belief = 'bayes'")
        object.__setattr__(self, "name", self.prior.name)

    @override
    def given(self, beliefs: IntArray) -> Policy:
        return _Given(self, beliefs)

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        return self.prior.decide_batch(step, positions, previous_velocities, alive)

    @override
    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        return self.prior.leaders(step, positions, previous_velocities, alive)


@dataclass(frozen=True, eq=False)
class _Given(Policy):
    """A policy in B states with beliefs (B, K), which calls that of each belief once."""

    policy: BayesPolicy
    beliefs: IntArray
    decision_tol: ClassVar[float] = SOLVER_TOL

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.policy.name

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        velocities = np.zeros_like(positions)
        counts = np.zeros((3, len(alive)), np.int64)
        for rows, policy in self._groups():
            state = positions[rows], previous_velocities[rows], alive[rows]
            decision = policy.decide_batch(step, *state)
            velocities[rows] = decision.velocities
            counts[:, rows] = decision.infeasible, decision.failures, decision.fallbacks
        return Decision(velocities, *counts)

    @override
    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        leaders = np.full(len(alive), -1)
        for rows, policy in self._groups():
            state = positions[rows], previous_velocities[rows], alive[rows]
            leaders[rows] = policy.leaders(step, *state)
        return leaders

    def _groups(self) -> list[tuple[IntArray, Policy]]:
        distinct, group = np.unique(self.beliefs, axis=0, return_inverse=True)
        bases = self.policy.scenario, self.policy.prior
        return [
            (np.flatnonzero(group.ravel() == k), _of_belief(*bases, tuple(belief.tolist())))
            for k, belief in enumerate(distinct)
        ]


@lru_cache(maxsize=2048)
def _of_belief(
    scenario: Scenario, prior: FormationPolicy | FeedbackPolicy, belief: tuple[int, ...]
) -> Policy:
    """The policy by a belief in units of the memory."""
    weights = np.array(belief) / sum(belief)
    return replace(prior, hazard=scenario.of_mean_rates(weights).hazard.sharing(prior.hazard))

"""Mixtures of joint plans for a hazard that is not known, best against a set of priors.

As for guides (`casswarm.guide.mixture`), the best mixture is the solution of a matrix game, to
which plans are added one by one: the best plan against the worst prior so far. A plan is the best
that a search finds, so the value is a lower end; the upper one, `casswarm.success_bound`, holds for
all policies, even if members knew the case.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from typing_extensions import override

from .._util.display import Displayed
from .._util.numbers import rounded_up
from .._util.text import counted
from ..bounds.success_bound import SuccessBound, success_bound
from ..scenario import Scenario
from ..scenario.ambiguity import Ambiguity, Mixture, of_game
from ..typing import FloatArray, Interval, Progress
from .plan_distribution import CasesDistribution, plan_law
from .swarm_plan import SwarmPlan

_ROUNDS = 12  # of adding plans
_ENOUGH = 1e-5  # gain of a plan from which it is added


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MixedPlan(Mixture, Displayed):
    """A distribution over joint plans for a hazard that is not known, and what it is worth.

    Parameters
    ----------
    plans : tuple of SwarmPlan
        Plans of positive weight, the likeliest first.
    pure : SwarmPlan
        The best single plan that is known.
    bound : SuccessBound, optional
        Of all policies, even if members knew the case.
    weights, survivals, prior, ambiguity, value, worst_prior, pure_value, known, note
        As of `casswarm.scenario.ambiguity.Mixture`, with success in place of survival.
    """

    plans: tuple[SwarmPlan, ...]
    pure: SwarmPlan
    bound: SuccessBound | None = None

    @property
    @override
    def routes(self) -> list[FloatArray]:
        return [plan.positions for plan in self.plans]

    def __repr__(self) -> str:
        low, high = self.value
        return (
            f"MixedPlan({self.ambiguity}, {counted(len(self.plans), 'plan')}, "
            f"value={low:.4f} to {rounded_up(high):.4f})"
        )

    def __str__(self) -> str:
        plans = ", ".join(
            f"{weight:.3f} ends at step {plan.steps}"
            for weight, plan in zip(self.weights, self.plans, strict=True)
        )
        return self._text(counted(len(self.plans), "joint plan"), "success", plans)


class Planner(Protocol):
    """Plans the members of a scenario for the prior over its cases."""

    def __call__(self, scenario: Scenario) -> SwarmPlan: ...


def plan_mixture(
    scenario: Scenario,
    ambiguity: Ambiguity,
    planner: Planner,
    certify: bool,
    deadline: float,
    progress: Progress | None,
) -> MixedPlan:
    """Best distribution over joint plans against a set of priors; see `plan_swarm`."""
    prior = np.array([case.weight for case in scenario.cases])
    plans: list[SwarmPlan] = []
    table: list[FloatArray] = []

    def add(weights: FloatArray) -> float:
        """Add the best plan for a prior; return its mean success."""
        plan = planner(scenario.with_prior(weights))
        law = plan_law(scenario, plan.positions)
        cases = law.cases if isinstance(law, CasesDistribution) else (law,)
        plans.append(replace(plan, distribution=law, value=1.0 - law.failure))
        table.append(np.array([case.success.low for case in cases]))
        return float(weights @ table[-1])

    for weights in (prior, *np.eye(len(prior))) if len(prior) > 1 else (prior,):
        add(weights)
    for number in range(_ROUNDS if ambiguity.name != "mean" else 0):
        worst = ambiguity.game(np.array(table), prior)[1]
        best = max(float(worst @ row) for row in table)
        if progress is not None:
            progress("plans against the worst prior", number, None)
        if time.perf_counter() > deadline or add(worst) <= best + _ENOUGH:
            break
    rows, fields = of_game(ambiguity, np.array(table), prior)
    bound = success_bound(scenario, ambiguity=ambiguity) if certify else None
    if bound is not None:
        fields["value"] = Interval(fields["value"].low, bound.value)
    return MixedPlan(
        plans=tuple(plans[row] for row in rows),
        pure=plans[int(np.argmax([ambiguity.least(row, prior) for row in table]))],
        known=np.max(table, axis=0),
        bound=bound,
        note="" if bound is None else "bounded even if members knew the case",
        **fields,
    )

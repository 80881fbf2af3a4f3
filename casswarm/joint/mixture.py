"""Mixtures of joint plans for a hazard that is not known, best against a set of priors.

As for guides (`casswarm.guide.mixture`), the best mixture is the solution of a matrix game, to
which plans are added one by one: the best plan against the worst prior so far. A plan is the best
that a search finds, so the value is a lower end; the upper one, `casswarm.success_bound`, holds for
all policies, even if members knew the case.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from typing_extensions import override

from .._util.display import Displayed
from .._util.text import counted
from ..bounds.success_bound import SuccessBound, success_bound
from ..errors import PlanningError
from ..guide.guide import Guide
from ..guide.plan import plan
from ..scenario import Scenario
from ..scenario.ambiguity import Ambiguity, AmbiguityLike, Mixture, of_game
from ..scenario.scenario_files import require_scenario
from ..typing import FloatArray, Interval
from .plan_distribution import MAX_EXACT, CasesDistribution, plan_law
from .search import plan_swarm
from .swarm_plan import SwarmPlan

_ROUNDS = 12  # of adding plans
_ENOUGH = 1e-5  # gain of a plan from which it is added
_OPTIONS = "solver", "initial_guesses", "seed", "min_distance", "solver_options", "progress"


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

    _unit: ClassVar[str] = "plan"

    @property
    @override
    def measure(self) -> str:
        return "success"

    @property
    @override
    def routes(self) -> list[FloatArray]:
        return [plan.positions for plan in self.plans]

    def __str__(self) -> str:
        return self._text(counted(len(self.plans), "joint plan"), self._chosen("ends"))


def plan_swarm_mixture(
    scenario: Scenario,
    ambiguity: AmbiguityLike = "worst",
    *,
    guide: Guide | None = None,
    certify: bool = True,
    time_limit: float | None = None,
    **options: Any,
) -> MixedPlan:
    """Distribution over joint plans with the best success against a set of priors over the cases.

    Parameters
    ----------
    scenario : Scenario
        Of at most 10 members, whose plans have an exact success.
    ambiguity : {"mean", "worst"}, ("cvar", a) or ("tv", r)
        The priors against which the mixture shall succeed, as in `casswarm.plan`.
    guide : Guide, optional
        Provides V(-1) if the scenario leaves that to the guide; planned for the prior by default.
    certify : bool
        Whether to bound the success of all policies.
    time_limit : float, optional
        Seconds after which no further solve starts.
    **options
        Of `plan_swarm`: solver, initial_guesses, seed, min_distance, solver_options, progress.

    Returns
    -------
    MixedPlan
        Of a hazard that is known, the mixture of one plan.

    Raises
    ------
    PlanningError
        An unknown set of priors, or more than 10 members; and as `plan_swarm`.
    TypeError
        Another option.

    Examples
    --------
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("two-gaps")
    >>> scenario = scenario.replace(swarm={"positions": [[0.0, 0.2], [0.0, -0.2]]})
    >>> options = {"certify": False, "time_limit": 1.0}
    >>> mixed = csw.plan_swarm_mixture(scenario, "worst", **options)
    >>> bool(mixed.pure_value <= mixed.value.low <= mixed.known_value)
    True
    """
    require_scenario("plan_swarm_mixture", scenario)
    chosen, deadline = Ambiguity.of(ambiguity), time.perf_counter() + (time_limit or math.inf)
    if unknown := options.keys() - set(_OPTIONS):
        allowed = ", ".join(("guide", "certify", "time_limit", *_OPTIONS))
        raise TypeError(f"plan_swarm_mixture takes no {min(unknown)!r}; allowed: {allowed}")
    if scenario.n > MAX_EXACT:
        raise PlanningError(
            f"{scenario.name!r} has {scenario.n} members; mixtures of plans are for at most "
            f"{MAX_EXACT}, whose success is exact",
            members=scenario.n,
        )
    guide = plan(scenario.believed, certify=False) if guide is None else guide
    plans = _Plans(scenario, deadline, options | {"guide": guide, "certify": False})
    prior = np.array([case.weight for case in scenario.cases])
    for weights in (prior, *np.eye(len(prior))) if len(prior) > 1 else (prior,):
        plans.add(weights)
    for _ in range(_ROUNDS if chosen.name != "mean" else 0):
        table = np.array(plans.successes)
        worst = chosen.game(table, prior)[1]
        best = float((table @ worst).max())
        if time.perf_counter() > deadline or plans.add(worst) <= best + _ENOUGH:
            break
    table = np.array(plans.successes)
    rows, fields = of_game(chosen, table, prior)
    bound = success_bound(scenario, ambiguity=chosen) if certify else None
    if bound is not None:
        fields["value"] = Interval(fields["value"].low, bound.value)
    return MixedPlan(
        plans=tuple(plans.plans[row] for row in rows),
        pure=plans.plans[int(np.argmax([chosen.least(row, prior) for row in table]))],
        known=table.max(axis=0),
        bound=bound,
        note="" if bound is None else "bounded even if members knew the case",
        **fields,
    )


@dataclass
class _Plans:
    """Joint plans for priors, and their successes (K,) in every case."""

    scenario: Scenario
    deadline: float
    options: dict[str, Any]
    plans: list[SwarmPlan] = field(default_factory=list)
    successes: list[FloatArray] = field(default_factory=list)

    def add(self, weights: FloatArray) -> float:
        """Add the best plan that is found for a prior; return its mean success."""
        left = self.deadline - time.perf_counter()
        limit: dict[str, Any] = {} if left == math.inf else {"time_limit": max(1e-3, left)}
        found = plan_swarm(self.scenario.with_prior(weights), **self.options, **limit)
        law = plan_law(self.scenario, found.positions)
        cases = law.cases if isinstance(law, CasesDistribution) else (law,)
        self.plans.append(replace(found, distribution=law, value=1.0 - law.failure))
        self.successes.append(np.array([case.success.low for case in cases]))
        return float(weights @ self.successes[-1])

"""Mixtures of guides of least mean risk, in place of survival: for comparison with the literature.

Means of risks are linear in the prior: against a prior q the best path is the guide for the mean
rates sum_k q_k rate_k, an ordinary hazard, with its certificate. So a certificate against any prior
in Q is a lower end of the game's value, and the mean risk of any mixture against the worst prior an
upper one. With limits of acceleration the lower end is of guides that end as deep in the target as
all paths of the mixture.

See Gilles and Vladimirsky, *Evasive path planning under surveillance uncertainty*, arXiv
1812.10620, and Cartee, Lai, Song and Vladimirsky, *Time-dependent surveillance-evasion games*,
arXiv 1903.01332.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from ..errors import PlanningError
from ..scenario import Scenario
from ..scenario.ambiguity import Ambiguity, of_game
from ..scenario.variations import require_default
from ..typing import FloatArray, Interval, Progress
from .agent import plan_from
from .certificate import TIME_LIMIT, certify_guide
from .guide import Guide
from .mixture import MixedGuide

_ROUNDS = 60  # of adding paths
_ENOUGH = 1e-6  # relative gain of a path from which it is added


def plan_risk_mixture(
    scenario: Scenario,
    ambiguity: Ambiguity,
    *,
    certify: bool,
    gap: float,
    time_limit: float | None,
    progress: Progress | None,
) -> MixedGuide:
    """Distribution over guides with the least mean risk against a set of priors; see `plan`.

    Raises
    ------
    PlanningError
        No guide for the mean rates arrives.
    ScenarioError
        Several target zones.
    """
    require_default(scenario, "target.other", "a mixture of guides")
    deadline = math.inf if time_limit is None else time.monotonic() + time_limit
    prior = np.array([case.weight for case in scenario.cases])
    paths = _Paths(scenario, deadline)
    for weights in (prior, *np.eye(len(prior))):
        paths.add(weights)
    for number in range(_ROUNDS):
        table = np.array(paths.risks)
        worst = ambiguity.game(-table, prior)[1]
        if progress is not None:
            progress("improving the mixture", number, None)
        least = float((table @ worst).min())
        if time.monotonic() > deadline or paths.add(worst) >= least * (1 - _ENOUGH):
            break
    return _mixed(paths, ambiguity, prior, certify, gap, deadline)


class _Paths:
    """Guides for mean rates, and their risks in every case."""

    def __init__(self, scenario: Scenario, deadline: float) -> None:
        self.scenario, self.deadline = scenario, deadline
        self.cases = [case.scenario.for_guide for case in scenario.cases]
        self.guides: list[Guide] = []
        self.risks: list[FloatArray] = []

    def add(self, weights: FloatArray) -> float:
        """Add the guide against a prior; return its mean risk."""
        guide = plan_from(
            self.scenario.of_mean_rates(weights),
            self.scenario.guide_start,
            initial_velocity=self.scenario.swarm.initial_velocity,
            time_limit=max(1e-3, self.deadline - time.monotonic()),
        )
        if not guide.arrives:
            raise PlanningError(
                f"no guide for the mean rates of weights {weights.tolist()} arrives"
            )
        rates = np.array([case.rates_along(guide.positions) for case in self.cases])
        prior = np.array([case.weight for case in self.scenario.cases])
        self.guides.append(replace(guide, rates=prior @ rates))
        self.risks.append(self.scenario.time.dt * rates.sum(axis=1))
        return float(weights @ self.risks[-1])


def _mixed(
    paths: _Paths,
    ambiguity: Ambiguity,
    prior: FloatArray,
    certify: bool,
    gap: float,
    deadline: float,
) -> MixedGuide:
    """The best mixture of the paths, with a lower end of the value if one is proven."""
    table = np.array(paths.risks)
    rows, fields = of_game(ambiguity, -table, prior)
    high, worst = -fields["value"].low, fields["worst_prior"]
    low = 0.0
    if certify:
        best = paths.guides[int((table @ worst).argmin())]
        mean = paths.scenario.of_mean_rates(worst)
        best = replace(best, rates=mean.for_guide.rates_along(best.positions))
        limit = time.monotonic() + TIME_LIMIT if deadline == math.inf else deadline
        kept = [paths.guides[row] for row in rows]
        certificate = certify_guide(mean, best, gap, limit, others=kept)
        low = 0.0 if certificate is None else certificate.risk_bound
    fields |= {"value": Interval(min(low, high), high), "survivals": np.exp(-table[rows])}
    single = [ambiguity.least(-row, prior) for row in table]
    own = zip(paths.cases, paths.guides[1:], strict=False)  # the first one is of the prior
    return MixedGuide(
        paths=tuple(paths.guides[row] for row in rows),
        pure=paths.guides[int(np.argmax(single))],
        guides=tuple(replace(one, rates=case.rates_along(one.positions)) for case, one in own),
        known=np.exp(-table.min(axis=0)),
        objective="risk",
        note="" if low > 0 else "not certified",
        **fields | {"pure_value": -max(single)},
    )

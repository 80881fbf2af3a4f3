"""What it is worth to know a hazard: success by the prior, the posterior and the true case."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd
from typing_extensions import Unpack

from .._util.progress import reporter
from .._util.settings import ENUMERATED, Accuracy, Execution, Keywords, given_values
from ..bounds.success_bound import success_bound
from ..chain.distribution import OutcomeDistribution
from ..errors import PolicyError, ScenarioError
from ..guide.agent import guide_solver
from ..guide.guide import Guide
from ..guide.plan import plan
from ..scenario.scenario_files import require_scenario
from .evaluation import evaluate
from .inputs import policy_list

if TYPE_CHECKING:
    from ..scenario import Scenario

INFORMATION = ("prior", "posterior", "true case")
"""What members know of the hazard."""


def value_of_information(
    scenario: Scenario,
    policies: Any = ("leader", "constrained"),
    *,
    guide: Guide | None = None,
    solver: str = "auto",
    accuracy: Accuracy | None = None,
    execution: Execution | None = None,
    **plain: Unpack[Keywords],
) -> pd.DataFrame:
    """Success of policies that know the prior of the hazard, the posterior, or the true case.

    The posterior is that given who has survived (``formation.belief = "bayes"``); for ``joint``,
    survivors replan (``joint-replanning``). Who knows the case has a guide, and plans, of its own
    for it. More information can harm a policy that does not use it well: only the best policies are
    never worse.

    Parameters
    ----------
    scenario : Scenario
        With several cases.
    policies : sequence or a single policy
        Names, of which `naive` and `joint` do not observe losses.
    guide : Guide, optional
        Of those who do not know the case; planned for the prior means of the rates by default.
    solver : str
        For the formation problems.
    accuracy, execution, **plain
        `tolerance`, `max_states`, `aggregation_tol` and `memory` as in `evaluate`, and `progress`.

    Returns
    -------
    DataFrame
        A row per policy and information: policy, information ("prior", "posterior" or "true case"),
        success_low and success_high, states, and bound, the success that no policy exceeds even if
        it knows the case. `casswarm.figures.information_chart` draws it.

    Raises
    ------
    ScenarioError
        The hazard is known.
    PolicyError
        Policies that are not names: they are made for one scenario.
    PlanningError
        No guide was found.

    Examples
    --------
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("two-gaps")
    >>> table = csw.value_of_information(scenario, "leader", tolerance=0.1)
    >>> table["information"].tolist()
    ['prior', 'posterior', 'true case']
    >>> low = table["success_low"].tolist()
    >>> low[0] < low[2]
    True
    """
    require_scenario("value_of_information", scenario)
    defaults = {**ENUMERATED, "progress": None}
    values = given_values("value_of_information", accuracy, execution, plain=plain, **defaults)
    *exact, progress = values
    names = policy_list(policies)
    if not all(isinstance(name, str) for name in names):
        raise PolicyError(
            "value_of_information takes names of policies: objects are made for one scenario"
        )
    if len(scenario.cases) == 1:
        raise ScenarioError(
            f"scenario '{scenario.name}' has a known hazard, so there is nothing to learn: give it "
            "cases (hazard.case)",
            key="hazard.case",
            value=1,
        )
    progress = reporter(progress)
    planner = guide_solver(solver)
    guides = [plan(case.scenario, planner, certify=False) for case in scenario.cases]
    guide = plan(scenario.believed, planner, certify=False) if guide is None else guide
    options = dict(zip(ENUMERATED, exact, strict=True)) | {"solver": solver, "progress": progress}
    bound, rows = success_bound(scenario).value, []
    for name in names:
        known = [
            (case.weight, evaluate(case.scenario, name, guide=own, **options))
            for case, own in zip(scenario.cases, guides, strict=True)
        ]
        laws = (
            evaluate(scenario.replace(formation={"belief": "prior"}), name, guide=guide, **options),
            _by_posterior(scenario, name, guide, options),
            OutcomeDistribution.of_cases(known),
        )
        rows += [
            {
                "policy": name,
                "information": information,
                "success_low": law.success.low,
                "success_high": law.success.high,
                "states": law.states,
                "bound": bound,
            }
            for information, law in zip(INFORMATION, laws, strict=True)
        ]
    return pd.DataFrame(rows)


def _by_posterior(
    scenario: Scenario, name: str, guide: Guide, options: Mapping[str, Any]
) -> OutcomeDistribution:
    bayes = scenario.replace(formation={"belief": "bayes"})
    return evaluate(bayes, "joint-replanning" if name == "joint" else name, guide=guide, **options)

"""Inputs that determine the results of a study: a checkpoint belongs to them."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from .._util.user_modules import code_hash
from ..hazard import CustomHazard
from ..policies.base import Policy
from ..policies.user import UserPolicy
from .policy_list import policy_name

if TYPE_CHECKING:
    from ..scenario import Scenario


def study_inputs(
    study: str, scenario: Scenario, policies: Sequence[str | Policy], **values: Any
) -> dict[str, Any]:
    """Inputs of a study as JSON values, with hashes of the code of the user that it calls.

    Parameters
    ----------
    study : str
    scenario : Scenario
    policies : sequence of str or Policy
    **values
        Further inputs.
    """
    hazard = scenario.hazard
    code = {"hazard": hazard.function if isinstance(hazard, CustomHazard) else type(hazard)}
    for policy in policies:
        if not isinstance(policy, str):
            code[policy.name] = policy.function if isinstance(policy, UserPolicy) else type(policy)
    hashes = {name: code_hash(found) for name, found in code.items()}
    return {
        "study": study,
        "scenario": tomllib.loads(scenario.to_toml()),
        "policies": list(map(policy_name, policies)),
        **values,
        "code": {name: found for name, found in hashes.items() if found},
        "casswarm": version("casswarm"),
    }

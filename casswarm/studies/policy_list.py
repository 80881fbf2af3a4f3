"""Policies as users name them: one or several, by name or as objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ..errors import PolicyError
from ..optimization.solvers import Solver
from ..planning.guide import Guide
from ..policies import as_policy, make_policy
from ..policies.base import Policy
from ..policies.registry import require_policy_name

if TYPE_CHECKING:
    from ..scenario import Scenario


def resolve_policy(
    policy: Any,
    scenario: Scenario,
    guide: Guide,
    solver: str | Solver,
    solver_options: Mapping[str, Any] | None = None,
) -> Policy:
    """Policy of a name, or of a function or object by `as_policy`."""
    if isinstance(policy, str):
        return make_policy(policy, scenario, guide, solver, solver_options=solver_options)
    return as_policy(policy)


def policy_list(policies: Any) -> list[Any]:
    """Names and `Policy` objects of a list of policies; a single policy is a list of one.

    Raises
    ------
    PolicyError
        An empty list, something that is not a policy, an unknown name, or several policies of the
        same name.
    """
    single = isinstance(policies, str) or hasattr(policies, "velocities")
    listed = [policies] if single or not isinstance(policies, Iterable) else list(policies)
    listed = [policy if isinstance(policy, str) else as_policy(policy) for policy in listed]
    names = list(map(policy_name, listed))
    for name in names:
        if not name.isprintable() or set(name) & set("/\\$") or not name.strip():
            raise PolicyError(
                f"policy name {name!r}: figures and files need printable characters, without "
                "slashes and '$'; as_policy(function, name=...) names a function",
                policy=name,
            )
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise PolicyError(
            f"policies need different names; repeated: {', '.join(repeated)}; "
            "as_policy(function, name=...) names a function",
            policy=repeated[0],
        )
    if not names:
        raise PolicyError("no policy given")
    for policy in listed:
        if isinstance(policy, str):
            require_policy_name(policy)
    return listed


def policy_name(policy: str | Policy) -> str:
    """Name of a policy of a `policy_list`."""
    return policy if isinstance(policy, str) else policy.name

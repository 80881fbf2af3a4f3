"""Policies as users name them, and the inputs that determine the results of a study."""

from __future__ import annotations

import time
import tomllib
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from numbers import Integral
from typing import TYPE_CHECKING, Any

from .._util.text import quoted
from .._util.user_code import code_hash
from ..chain.transition import Lattice
from ..errors import CasswarmWarning, PolicyError
from ..guide.agent import guide_solver, initial_velocities
from ..guide.guide import Guide
from ..guide.plan import plan
from ..hazard import CustomHazard, Hazard
from ..policies import as_policy, make_policy
from ..policies.base import Policy
from ..policies.formation_policies import FeedbackPolicy, FormationPolicy
from ..policies.named import require_policy_name
from ..policies.user import UserPolicy
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Progress

if TYPE_CHECKING:
    from ..scenario import Scenario


@dataclass(frozen=True, eq=False)
class PosedStudy:
    """A scenario, its guide, and the policies that a study runs."""

    scenario: Scenario
    guide: Guide
    policies: list[Policy]
    progress: Progress | None

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        policies: Any,
        guide: Guide | None,
        solver: str | Solver = "auto",
        solver_options: Mapping[str, Any] | None = None,
        progress: Progress | None = None,
    ) -> PosedStudy:
        """Policies as in `policy_list`, and the guide as it is given, or planned uncertified."""
        listed = policy_list(policies)
        make_solver(solver, **(solver_options or {}))  # before planning, which takes longer
        if guide is None:
            guide = plan(scenario.believed, guide_solver(solver), certify=False, progress=progress)
        resolved = [resolve_policy(p, scenario, guide, solver, solver_options) for p in listed]
        solves = any(isinstance(policy, FormationPolicy | FeedbackPolicy) for policy in resolved)
        if solves and isinstance(scenario.believed.hazard, CustomHazard):
            progress = SlowRates(scenario.believed.hazard, progress)
        return cls(scenario, guide, resolved, progress)

    @cached_property
    def velocities(self) -> FloatArray:
        """V(-1) (n, 2)."""
        return initial_velocities(self.scenario, self.guide)

    def lattice(self, aggregation_tol: float | None) -> Lattice | None:
        """Lattice of the positions, by default as fine as the first policy decides."""
        accuracy = self.policies[0].decision_tol
        return Lattice.along(self.guide, self.scenario, aggregation_tol, accuracy)


SLOW = 10.0
"""Seconds of work after which a study says that rates made of kernels are faster."""


class SlowRates:
    """Progress of a study whose rates are a function, which warns once where it takes long."""

    def __init__(self, hazard: Hazard, progress: Progress | None) -> None:
        self._hazard, self._progress = hazard, progress
        self._begin: float | None = time.perf_counter()

    def __call__(self, task: str, done: float, total: float | None) -> None:
        """Report progress, and warn if the work is not done after `SLOW` seconds."""
        if self._progress is not None:
            self._progress(task, done, total)
        late = self._begin is not None and time.perf_counter() - self._begin > SLOW
        if late and (total is None or done < total):
            self._begin = None
            warnings.warn(
                f"{self._hazard!r} is a function: its formation problems are solved one by one, "
                "hundreds of times slower than those of rates made of kernels; see KernelHazard in "
                "docs/own-rates.md",
                CasswarmWarning,
                stacklevel=2,
            )


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


_LONGEST_NAME = 100  # characters, as of a scenario


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
        allowed = name.isprintable() and not set(name) & set("/\\$") and name.strip()
        if not allowed or len(name) > _LONGEST_NAME:
            raise PolicyError(
                f"policy name {quoted(name)}: figures and files need printable characters, at most "
                f"{_LONGEST_NAME}, without slashes and '$'; as_policy(function, name=...) names a "
                "function",
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
        raise PolicyError("no policy given; name at least one, such as 'leader'")
    for policy in listed:
        if isinstance(policy, str):
            require_policy_name(policy)
    return listed


def policy_name(policy: str | Policy) -> str:
    """Name of a policy of a `policy_list`."""
    return policy if isinstance(policy, str) else policy.name


def study_inputs(
    study: str, scenario: Scenario, policies: Sequence[str | Policy], **values: Any
) -> dict[str, Any]:
    """Inputs of a study as JSON values, with hashes of the code of the user that it calls."""
    code: dict[str, Any] = {}
    for number, case in enumerate(scenario.cases):
        hazard = case.scenario.hazard.after(1)
        name = f"hazard.case[{number}]" if number else "hazard"
        code[name] = hazard.function if isinstance(hazard, CustomHazard) else type(hazard)
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


def require_runs(name: str, value: object) -> int:
    """The value as a number of runs; ValueError if it is none."""
    if not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} = {value}; allowed: whole numbers from 1")
    return int(value)

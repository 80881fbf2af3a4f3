"""Points of a sweep: a combination of parameter values and a policy, as a job."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from ..errors import CasswarmError
from ..planning.guide import Guide
from ..planning.plan import guide_solver, plan
from ..policies.base import Policy
from ..scenario.variations import with_parameters
from .evaluation import evaluate
from .policy_list import policy_name
from .simulation import simulate
from .tables import distribution_table

if TYPE_CHECKING:
    from ..scenario import Scenario

MEASURES = (
    "success",
    "success_low",
    "success_high",
    "survivors_mean",
    "survivors_mean_low",
    "survivors_mean_high",
    "infeasible_mean",
    "solver_failures_mean",
    "guide_survival",
)
"""Numbers of a sweep point; those that do not apply are missing."""

COUNTS = ("runs", "successes", "states")
"""Columns of whole numbers; those that do not apply are missing."""

_TOO_LARGE = 2**63  # for a column of a table


@dataclass(frozen=True)
class SweepPoint:
    """A combination of parameter values and a policy, as a job for a worker.

    `options` are arguments of `simulate` if they have `runs`, else of `evaluate`. Errors that the
    inputs cause become part of the result.
    """

    scenario: Scenario
    values: Mapping[str, Any]
    policy: str | Policy
    options: Mapping[str, Any]

    def identity(self) -> dict[str, Any]:
        """Columns that identify the point."""
        shown = {
            key: json.dumps(value) if isinstance(value, (list, tuple, dict)) else value
            for key, value in self.values.items()
        }
        return {**shown, "policy": policy_name(self.policy)}

    def __call__(self) -> dict[str, Any]:
        """Compute the point: its other columns, and the seconds that it took."""
        started, sampled = time.perf_counter(), "runs" in self.options
        row: dict[str, Any] = {"method": "sampled" if sampled else "exact"}
        row |= dict.fromkeys(MEASURES, math.nan) | dict.fromkeys(COUNTS) | {"reason": ""}
        try:
            scenario = with_parameters(self.scenario, self.values)
            guide = _guide(scenario, guide_solver(self.options["solver"]))
            row["guide_survival"] = float(guide.survival)
            row |= self._sampled(scenario, guide) if sampled else self._exact(scenario, guide)
            row["status"] = "ok"
        except (CasswarmError, ValueError, ArithmeticError, RuntimeError, MemoryError) as error:
            row |= {"status": "failed", "reason": f"{type(error).__name__}: {error}"}
        return {"columns": row, "seconds": time.perf_counter() - started}

    def _exact(self, scenario: Scenario, guide: Guide) -> dict[str, Any]:
        distribution = evaluate(scenario, self.policy, guide=guide, **self.options)
        row = distribution_table([distribution]).to_dict("records")[0]
        return {name: row[name] for name in (*MEASURES, "states") if name in row} | {
            "success": distribution.success.midpoint,
            "survivors_mean": distribution.survivors_mean.midpoint,
            "reason": distribution.advice,  # empty if the bounds are as narrow as requested
        }

    def _sampled(self, scenario: Scenario, guide: Guide) -> dict[str, Any]:
        study = simulate(scenario, self.policy, guide=guide, save_trajectories=0, **self.options)
        row = study.summary.to_dict("records")[0]
        same = ("success_low", "success_high", "success", "survivors_mean", "runs", "successes")
        return {name: row[name] for name in same} | {
            f"{name}_mean": row[name] / row["runs"] for name in ("infeasible", "solver_failures")
        }


def is_computed(result: Any) -> bool:
    """Whether a saved result is one of a sweep point that did not fail."""
    try:
        row, numbers = result["columns"], [result["seconds"]]
        numbers += [row[name] for name in MEASURES]
        counts = [row[name] for name in COUNTS]
        return (
            row["status"] == "ok"
            and row.keys() == {"method", "status", "reason", *MEASURES, *COUNTS}
            and all(isinstance(row[name], str) for name in ("method", "reason"))
            and all(isinstance(number, int | float) for number in numbers)
            and all(row[name] is None or type(row[name]) is int for name in COUNTS)
            and all(number is None or not abs(number) >= _TOO_LARGE for number in numbers + counts)
        )
    except (TypeError, LookupError, AttributeError):
        return False


@lru_cache(maxsize=32)
def _guide(scenario: Scenario, solver: str) -> Guide:
    """Guide of a scenario, planned once for all policies."""
    return plan(scenario, solver, certify=False)

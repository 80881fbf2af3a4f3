"""One cell of a sweep: a policy on a scenario with some parameters, exact or sampled."""

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
from ..planning.plan import plan
from ..scenario.variations import with_parameters
from .evaluation import evaluate
from .simulation import simulate

if TYPE_CHECKING:
    from ..scenario import Scenario

MEASURES = (
    "success",
    "success_low",
    "success_high",
    "survivors_mean",
    "survivors_mean_low",
    "survivors_mean_high",
    "shortfalls_mean",
    "solver_failures_mean",
    "guide_survival",
)
"""Numbers of a cell; those that do not apply are missing."""


@dataclass(frozen=True)
class Options:
    """How all cells are done; as in `casswarm.studies.sweep.sweep`."""

    runs: int | None
    seed: int
    tolerance: float
    max_states: int | None
    aggregation_tol: float
    solver: str


@dataclass(frozen=True)
class SweepPoint:
    """One combination and one policy: a job that never raises what its inputs are to blame for."""

    scenario: Scenario
    values: Mapping[str, Any]
    policy: Any
    options: Options

    @property
    def policy_name(self) -> str:
        """Name of the policy."""
        return self.policy if isinstance(self.policy, str) else str(self.policy.name)

    def identity(self) -> dict[str, Any]:
        """The columns that tell which cell it is."""
        shown = {
            key: json.dumps(value) if isinstance(value, (list, tuple, dict)) else value
            for key, value in self.values.items()
        }
        return {**shown, "policy": self.policy_name}

    def __call__(self) -> dict[str, Any]:
        """What was found, and the seconds that it took."""
        started = time.perf_counter()
        row: dict[str, Any] = dict.fromkeys(("method", *MEASURES, "runs", "successes", "states"))
        row["reason"] = ""
        row |= dict.fromkeys(MEASURES, math.nan)
        row["method"] = "exact" if self.options.runs is None else "sampled"
        try:
            scenario = with_parameters(self.scenario, self.values)
            guide = _planned(scenario)
            row["guide_survival"] = float(guide.survival)
            row |= (
                self._exact(scenario, guide)
                if self.options.runs is None
                else self._sampled(scenario, guide)
            )
            row["status"] = "ok"
        except (CasswarmError, ValueError, ArithmeticError, RuntimeError, MemoryError) as error:
            row |= {"status": "failed", "reason": f"{type(error).__name__}: {error}"}
        return {"found": row, "seconds": time.perf_counter() - started}

    def _exact(self, scenario: Scenario, guide: Guide) -> dict[str, Any]:
        given = self.options
        law = evaluate(
            scenario,
            self.policy,
            given.tolerance,
            max_states=given.max_states,
            aggregation_tol=given.aggregation_tol,
            guide=guide,
            solver=given.solver,
        )
        (low, high), (fewest, most) = law.success, law.survivors_mean
        return {
            "success": 0.5 * (low + high),
            "success_low": low,
            "success_high": high,
            "survivors_mean": 0.5 * (fewest + most),
            "survivors_mean_low": fewest,
            "survivors_mean_high": most,
            "shortfalls_mean": law.infeasible,
            "solver_failures_mean": law.failures,
            "states": law.states,
            "reason": law.advice,  # empty where the bracket is as narrow as was asked for
        }

    def _sampled(self, scenario: Scenario, guide: Guide) -> dict[str, Any]:
        runs = self.options.runs
        assert runs is not None
        study = simulate(
            scenario,
            [self.policy],
            runs,
            self.options.seed,
            guide=guide,
            solver=self.options.solver,
            save_trajectories=0,
        )
        summary = study.summary.iloc[0]
        return {
            "success": float(summary["success"]),
            "success_low": float(summary["success_low"]),
            "success_high": float(summary["success_high"]),
            "survivors_mean": float(summary["survivors_mean"]),
            "shortfalls_mean": float(summary["infeasible"] / runs),
            "solver_failures_mean": float(summary["solver_failures"] / runs),
            "runs": runs,
            "successes": int(summary["successes"]),
        }


@lru_cache(maxsize=32)
def _planned(scenario: Scenario) -> Guide:
    """The guide of a scenario, once for all of its policies."""
    return plan(scenario, certify=False)

"""One point of a sweep: a policy on a scenario with changed parameters, exact or sampled."""

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
from .policy_list import policy_name
from .simulation import simulate
from .tables import distribution_table

if TYPE_CHECKING:
    from ..scenario import Scenario

MEASURES = (
    "success_low",
    "success_high",
    "success",
    "survivors_mean",
    "survivors_mean_low",
    "survivors_mean_high",
    "infeasible_mean",
    "solver_failures_mean",
    "guide_survival",
)
"""Numbers of a sweep point; those that do not apply are missing."""


@dataclass(frozen=True)
class SweepOptions:
    """Options of all sweep points; as in `casswarm.studies.sweep.sweep`."""

    runs: int | None
    seed: int
    tolerance: float
    max_states: int | None
    aggregation_tol: float
    solver: str


@dataclass(frozen=True)
class SweepPoint:
    """A combination of parameter values and a policy, as a job for a worker.

    Errors that its inputs cause become part of its result.
    """

    scenario: Scenario
    values: Mapping[str, Any]
    policy: Any
    options: SweepOptions

    @property
    def policy_name(self) -> str:
        """Name of the policy."""
        return policy_name(self.policy)

    def identity(self) -> dict[str, Any]:
        """Columns that identify the point."""
        shown = {
            key: json.dumps(value) if isinstance(value, (list, tuple, dict)) else value
            for key, value in self.values.items()
        }
        return {**shown, "policy": self.policy_name}

    def __call__(self) -> dict[str, Any]:
        """Compute the point: its other columns, and the seconds that it took."""
        started = time.perf_counter()
        runs = self.options.runs
        row: dict[str, Any] = {"method": "exact" if runs is None else "sampled"}
        row |= dict.fromkeys(MEASURES, math.nan)
        row |= {"runs": None, "successes": None, "states": None, "reason": ""}
        try:
            scenario = with_parameters(self.scenario, self.values)
            guide = _guide(scenario)
            row["guide_survival"] = float(guide.survival)
            if runs is None:
                row |= self._exact(scenario, guide)
            else:
                row |= self._sampled(scenario, guide, runs)
            row["status"] = "ok"
        except (CasswarmError, ValueError, ArithmeticError, RuntimeError, MemoryError) as error:
            row |= {"status": "failed", "reason": f"{type(error).__name__}: {error}"}
        return {"columns": row, "seconds": time.perf_counter() - started}

    def _exact(self, scenario: Scenario, guide: Guide) -> dict[str, Any]:
        options = self.options
        distribution = evaluate(
            scenario,
            self.policy,
            options.tolerance,
            max_states=options.max_states,
            aggregation_tol=options.aggregation_tol,
            guide=guide,
            solver=options.solver,
        )
        row = distribution_table([distribution]).to_dict("records")[0]
        return {name: row[name] for name in (*MEASURES, "states") if name in row} | {
            "success": distribution.success.midpoint,
            "survivors_mean": distribution.survivors_mean.midpoint,
            "reason": distribution.advice,  # empty if the bounds are as narrow as requested
        }

    def _sampled(self, scenario: Scenario, guide: Guide, runs: int) -> dict[str, Any]:
        seed, solver = self.options.seed, self.options.solver
        study = simulate(
            scenario, [self.policy], runs, seed, guide=guide, solver=solver, save_trajectories=0
        )
        row = study.summary.to_dict("records")[0]
        same = ("success_low", "success_high", "success", "survivors_mean", "runs", "successes")
        return {name: row[name] for name in same} | {
            f"{name}_mean": row[name] / runs for name in ("infeasible", "solver_failures")
        }


@lru_cache(maxsize=32)
def _guide(scenario: Scenario) -> Guide:
    """Guide of a scenario, planned once for all policies."""
    return plan(scenario, certify=False)

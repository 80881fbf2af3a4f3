"""Sweeps: policies over a grid of scenario parameters, exact or sampled, as one tidy table."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from typing_extensions import Unpack

from .._util.checkpoint import opened
from .._util.child import done_jobs, require_sendable, require_workers
from .._util.display import Displayed
from .._util.numbers import require_seed
from .._util.parts import part_of
from .._util.progress import reporter
from .._util.settings import ENUMERATED, SAVED, Accuracy, Execution, Keywords, given_values
from .._util.text import counted
from ..errors import CasswarmError, ScenarioError
from ..guide.agent import guide_solver
from ..guide.guide import Guide
from ..guide.plan import plan
from ..policies.base import Policy
from ..scenario.scenario_files import require_scenario
from ..scenario.validation import NO_SUCH_KEY
from ..scenario.variations import DERIVED, whole_numbers, with_parameters
from ..solvers import make_solver
from ..typing import Seed
from .evaluation import evaluate
from .inputs import policy_list, policy_name, study_inputs
from .simulation import PAPER_POLICIES, simulate
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
    """Return True if a saved result is one of a sweep point that did not fail."""
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
    return plan(scenario.believed, solver, certify=False)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Displayed):
    """Results of a sweep.

    Parameters
    ----------
    scenario : Scenario
        The scenario whose parameters were changed.
    keys : tuple of str
        The parameters.
    table : DataFrame
        A row per sweep point, in the order of the grid: a column per parameter, policy, method
        ("exact" or "sampled"), the numbers of `MEASURES`, runs and successes or states, status
        ("ok" or "failed") and reason.
    effort : DataFrame
        Seconds of every sweep point. Not reproducible.
    """

    scenario: Scenario
    keys: tuple[str, ...]
    table: pd.DataFrame
    effort: pd.DataFrame

    @property
    def failures(self) -> int:
        """Number of sweep points that failed."""
        return int((self.table["status"] != "ok").sum())

    def __repr__(self) -> str:
        keys = ", ".join(self.keys)
        return f"Sweep({self.scenario.name!r} over {keys}: {counted(len(self.table), 'point')})"

    def __str__(self) -> str:
        name, points = self.scenario.name, len(self.table)
        return f"{name}: {counted(points, 'sweep point')}, {self.failures} failed\n{self.table}"


def sweep(
    scenario: Scenario,
    settings: Mapping[str, Sequence[Any]],
    policies: Any = PAPER_POLICIES,
    *,
    runs: int | None = None,
    seed: Seed = 0,
    solver: str = "auto",
    accuracy: Accuracy | None = None,
    execution: Execution | None = None,
    **plain: Unpack[Keywords],
) -> Sweep:
    """Evaluate policies on every combination of parameter values.

    A sweep point that fails (no guide, wrong values) is a row with its reason; the others go on.

    Parameters
    ----------
    scenario : Scenario
    settings : mapping of key to values
        Dotted keys as `Scenario.with_values` takes them, such as ``"formation.rho"``; and two more:
        ``"spacing"`` scales the initial positions about their centroid until the nearest two
        members are so far apart, and ``"n"`` takes the first n members, or adds members at the
        nearest free positions of a triangular lattice about the centroid.
    policies : sequence or a single policy
        As in `simulate`.
    runs : int, optional
        Number of runs per sweep point; without it, distributions are exact, as by `evaluate`.
    seed : int
        Of the runs, as in `simulate`; all sweep points see the same random numbers.
    solver : str
        For the formation problems.
    accuracy, execution, **plain
        Values of `Accuracy` and `Execution`, in these records or as plain keywords:

        - `tolerance`, by default 1e-3, `max_states`, `aggregation_tol` and `memory` as in
          `evaluate`.
        - `workers` as in `simulate`; the jobs are sweep points.
        - `checkpoint` and `if_exists` as in `simulate`; every sweep point is saved when it is
          finished.
        - `progress`, which receives "sweep points", the number of finished ones, and their total.

    Raises
    ------
    ScenarioError
        An unknown key, a key without values, or fractions for one of whole numbers, such as n.
    SolverError
        An unknown solver.
    PolicyError, CheckpointError, ValueError, TypeError
        As in `simulate`.
    """
    require_scenario("sweep", scenario)
    defaults = {**ENUMERATED, "workers": 1, **SAVED}
    values = given_values("sweep", accuracy, execution, plain=plain, **defaults)
    *exact, workers, progress, checkpoint, if_exists = values
    require_workers(workers)
    seed, progress = require_seed(seed), reporter(progress)
    grid = _checked_settings(scenario, settings)
    sampled = {"runs": int(runs), "seed": seed} if runs is not None else None
    options = {"solver": solver, **(sampled or dict(zip(ENUMERATED, exact, strict=True)))}
    listed = policy_list(policies)
    make_solver(solver)
    points = [
        SweepPoint(scenario, dict(zip(grid, values, strict=True)), policy, options)
        for values in product(*grid.values())
        for policy in listed
    ]
    names = [f"point-{index:06d}" for index in range(len(points))]  # of checkpoint records
    # the order of the keys is that of the sweep points
    inputs = {"settings": grid, "keys": list(grid), "options": options}
    described = partial(study_inputs, "sweep", scenario, listed, **inputs)
    results: dict[int, dict[str, Any]] = {}
    with opened(checkpoint, described, if_exists) as store:
        if store is not None:
            saved = {k: store.load_json(name) for k, name in enumerate(names)}
            # sweep points that failed are computed again
            results = {k: result for k, result in saved.items() if is_computed(result)}
        part = part_of(checkpoint)
        missing = [k for k in range(len(points)) if part.owns(k) and k not in results]
        number = len(results) + len(missing)
        if workers != 1 and missing:
            require_sendable({policy_name(point.policy): point for point in points})
        for job, result in done_jobs([points[index] for index in missing], workers):
            results[missing[job]] = result
            if store is not None:
                store.save_json(names[missing[job]], result)
            if progress is not None:
                progress("sweep points", len(results), number)
    rows = [point.identity() | results[k]["columns"] for k, point in enumerate(points)]
    table = pd.DataFrame(rows).astype(dict.fromkeys(COUNTS, "Int64"))
    seconds = [results[k]["seconds"] for k in range(len(points))]
    effort = pd.DataFrame({"point": range(len(points)), "seconds": seconds})
    return Sweep(scenario, tuple(grid), table, effort)


def _python_numbers(values: Sequence[Any]) -> Any:
    """Convert NumPy's numbers to Python's, so that they can be written as JSON."""
    if isinstance(values, str):
        return values
    return [value.item() if isinstance(value, np.generic) else value for value in values]


def _checked_settings(scenario: Scenario, settings: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    settings = {key: _python_numbers(values) for key, values in settings.items()}
    for key, values in settings.items():
        if isinstance(values, str) or not len(values):
            raise ScenarioError(
                f"{key} has no values: give a list of them, such as [0.05, 0.1]",
                key=key,
                value=values,
            )
        try:
            json.dumps(values)
        except (TypeError, ValueError) as error:
            raise ScenarioError(
                f"{key} has a value that no scenario has: {error}", key=key, value=values
            ) from None
    if "swarm.positions" in settings and DERIVED.keys() & settings.keys():
        raise ScenarioError(
            "swarm.positions cannot be swept together with n or spacing", key="swarm.positions"
        )
    for key in settings.keys() - DERIVED.keys():
        try:
            with_parameters(scenario, {key: settings[key][0]})
        except ScenarioError as error:
            if NO_SUCH_KEY in str(error):
                raise
    return {key: whole_numbers(key, values) for key, values in settings.items()}

"""Success probabilities: the paper's, exact and sampled, and those of other scenarios."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pandas as pd

from ..optimization.solvers import ProjectedGradient
from ..planning.guide import Guide
from ..planning.homotopy import homotopy_signature
from ..planning.plan import guide_solver, plan
from ..scenario import Scenario, load_scenario
from ..studies.evaluation import estimate, evaluate
from ..studies.simulation import PAPER_POLICIES, simulate
from ..typing import Interval
from .paper import PAPER_RUNS, PAPER_SUCCESS, paper_interval

WIDTH = 1e-3
"""Width of the exact bounds of Table II."""

STATES, RUNS = 150_000, 2000
"""Elsewhere: states after which the residual mass is sampled, and runs that sample it."""

METHOD = ProjectedGradient.name
METHOD_STATES = 30_000
"""The paper's method, and its `STATES`: its solves cost a hundred times as much."""

Report = Callable[[str], None]
"""Receives the name of the current task."""

DIGITS = 6  # of probabilities in tables: more differ between processors


def table_2(
    scenario: Scenario, guide: Guide, runs: int = RUNS, seed: int = 0, tolerance: float = WIDTH
) -> pd.DataFrame:
    """Table II: the paper's, by the paper's method, and along `guide` with the default solver.

    The paper's method plans guides and formations by projected gradient, with the settings of Table
    I. Columns: policy; the paper's number and its Wilson interval (of 50 runs); the method's, of as
    many runs, with theirs; its success, method_low to method_high, with method_kind as in `beyond`
    (sampled by `runs`); the exact bounds along `guide`, no wider than `tolerance`; and whether the
    last two lie in the paper's interval.
    """
    own = plan(scenario, METHOD, certify=False)
    few = simulate(
        scenario, PAPER_POLICIES, PAPER_RUNS, seed, guide=own, solver=METHOD, save_trajectories=0
    ).summary
    rows = []
    for number, policy in enumerate(PAPER_POLICIES):
        low, high = paper_interval(policy)
        exact = evaluate(scenario, policy, tolerance, guide=guide).success
        method, kind, _ = success_of(scenario, policy, own, solver=METHOD, runs=runs, seed=seed)
        rows.append(
            {
                "policy": policy,
                "paper": PAPER_SUCCESS[policy],
                "paper_low": low,
                "paper_high": high,
                **{
                    f"runs_{PAPER_RUNS}{end}": few.loc[number, f"success{end}"]
                    for end in ("", "_low", "_high")
                },
                "method_low": method.low,
                "method_high": method.high,
                "method_kind": kind,
                "exact_low": exact.low,
                "exact_high": exact.high,
                "method_within": low <= method.low and method.high <= high,
                "exact_within": low <= exact.low and exact.high <= high,
            }
        )
    return pd.DataFrame(rows).round(DIGITS)


def success_of(
    scenario: Scenario,
    policy: str,
    guide: Guide,
    *,
    solver: str = "auto",
    states: int | None = None,
    runs: int = RUNS,
    seed: int = 0,
) -> tuple[Interval, str, float]:
    """Success, its kind, and the mean number of infeasible member-steps (of the enumerated part).

    The kind is "proven" if the bounds are exact and at most `WIDTH` wide after `states` states,
    else "95 %": an interval, because the residual mass was sampled by `runs` runs. By default
    there are `STATES`, or `METHOD_STATES`.
    """
    if states is None:
        states = METHOD_STATES if solver == METHOD else STATES
    part = evaluate(scenario, policy, WIDTH, max_states=states, guide=guide, solver=solver)
    if part.complete:
        return part.success, "proven", part.infeasible
    fewer = states // 15
    sampled = estimate(
        scenario,
        policy,
        runs,
        seed,
        max_states=fewer,
        tolerance=1e-4,
        guide=guide,
        solver=solver,
    )
    return sampled.success, "95 %", sampled.enumerated.infeasible


def variants() -> dict[str, tuple[Scenario, str]]:
    """Scenarios beyond the paper's, and the solvers of their formations, by their titles."""
    first, second = load_scenario("paper-1"), load_scenario("paper-2")
    best = {"guide.search": "global", "guide.arrival": "any"}
    alley = load_scenario("alley")
    collisions = {
        "hazard.kind": "saturation+collision",
        "hazard.beta_1": 0.2,
        "hazard.beta_2": 6.0,
    }
    scenarios = {
        "I: the paper's, local guide": first,
        "I: global guide": first.with_values(best),
        "I: alley": alley,
        "I: wall": load_scenario("wall"),
        "I: ring": load_scenario("ring"),
        "II: the paper's, local guide": second,
        "II: global guide": second.with_values(best),
        "II: alley": alley.with_values(collisions),
    }
    method = {"II: the paper's method": (second, METHOD)}
    return {title: (scenario, "auto") for title, scenario in scenarios.items()} | method


def beyond(
    scenarios: Mapping[str, tuple[Scenario, str]],
    report: Report,
    *,
    states: int | None = None,
    runs: int = RUNS,
    seed: int = 0,
) -> pd.DataFrame:
    """Success of the paper's policies in `variants`, a row per scenario and policy.

    The guides of "auto" are Ipopt's, those of the projected gradient its own. Columns: scenario;
    policy; the guide's arrival step, survival and homotopy signature;
    success_low, success_high, kind and infeasible as in `success_of`.
    """
    rows = []
    for name, (scenario, solver) in scenarios.items():
        report(name)
        guide = plan(scenario, guide_solver(solver), certify=False)
        homotopy = homotopy_signature(guide.positions, scenario.hazard.radar_positions)
        for policy in PAPER_POLICIES:
            success, kind, infeasible = success_of(
                scenario, policy, guide, solver=solver, states=states, runs=runs, seed=seed
            )
            rows.append(
                {
                    "scenario": name,
                    "policy": policy,
                    "arrival": guide.arrival,
                    "guide_survival": guide.survival,
                    "homotopy": homotopy,
                    "success_low": success.low,
                    "success_high": success.high,
                    "kind": kind,
                    "infeasible": round(infeasible, 2),
                }
            )
    return pd.DataFrame(rows).round(DIGITS)

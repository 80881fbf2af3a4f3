"""Success probabilities: the paper's, exact and sampled, and those of other scenarios."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from ..planning.guide import Guide
from ..planning.homotopy import homotopy_signature
from ..planning.plan import plan
from ..scenario import Scenario, load_scenario
from ..studies.evaluation import estimate, evaluate
from ..studies.simulation import PAPER_POLICIES, simulate
from .paper import PAPER_RUNS, PAPER_SUCCESS, paper_interval

WIDTH = 1e-3
"""Width of the exact bounds of Table II."""

STATES, RUNS = 150_000, 2000
"""Elsewhere: states after which the residual mass is sampled, and runs that sample it."""

Report = Callable[[str], None]
"""Receives the name of the current task."""

DIGITS = 6  # of probabilities in tables: more differ between processors


def table_2(
    scenario: Scenario, guide: Guide, runs: int = 10_000, seed: int = 0, tolerance: float = WIDTH
) -> pd.DataFrame:
    """Table II from four sources, a row per policy.

    Columns: policy; the paper's number and its Wilson interval (of 50 runs); the exact bounds, no
    wider than `tolerance`; the paper's method repeated (50 runs of plain Monte Carlo), and `runs`
    of them, each with its Wilson interval; whether the exact bounds lie in the paper's interval.
    """
    samples = {
        count: simulate(
            scenario, PAPER_POLICIES, count, seed, guide=guide, save_trajectories=0
        ).summary
        for count in (PAPER_RUNS, runs)
    }
    rows = []
    for number, policy in enumerate(PAPER_POLICIES):
        low, high = paper_interval(policy)
        exact = evaluate(scenario, policy, tolerance, guide=guide).success
        sampled = {
            f"runs_{count}{suffix}": summary.loc[number, f"success{suffix}"]
            for count, summary in samples.items()
            for suffix in ("", "_low", "_high")
        }
        rows.append(
            {
                "policy": policy,
                "paper": PAPER_SUCCESS[policy],
                "paper_low": low,
                "paper_high": high,
                "exact_low": exact.low,
                "exact_high": exact.high,
                **sampled,
                "within_paper_interval": low <= exact.low and exact.high <= high,
            }
        )
    return pd.DataFrame(rows).round(DIGITS)


def variants() -> dict[str, Scenario]:
    """Scenarios beyond the paper's, by their titles."""
    first, second = load_scenario("paper-1"), load_scenario("paper-2")
    best = {"guide.search": "global", "guide.arrival": "any"}
    short = {**best, "time.t_f": 4.0}
    return {
        "I: the paper's, local guide": first,
        "I: global guide": first.with_values(best),
        "I: no time to go around, t_f = 4": first.with_values(short),
        "I: wall": load_scenario("wall"),
        "I: ring": load_scenario("ring"),
        "II: the paper's, local guide": second,
        "II: global guide": second.with_values(best),
        "II: no time to go around, t_f = 4": second.with_values(short),
    }


def beyond(
    scenarios: Mapping[str, Scenario],
    report: Report,
    *,
    states: int = STATES,
    runs: int = RUNS,
    seed: int = 0,
) -> pd.DataFrame:
    """Success of the paper's policies in other scenarios, a row per scenario and policy.

    Columns: scenario; policy; the guide's arrival step, survival and homotopy signature;
    success_low and success_high; kind: "proven" if the bounds are exact and at most `WIDTH` wide,
    else "95 %": an interval, because the residual mass was sampled; infeasible: mean number of
    infeasible member-steps per run (of the enumerated part).
    """
    rows = []
    for name, scenario in scenarios.items():
        report(name)
        guide = plan(scenario, certify=False)
        homotopy = homotopy_signature(guide.positions, scenario.hazard.radar_positions)
        for policy in PAPER_POLICIES:
            part = evaluate(scenario, policy, WIDTH, max_states=states, guide=guide)
            success, kind = part.success, "proven"
            if not part.complete:
                fewer = states // 15
                sampled = estimate(
                    scenario, policy, runs, seed, max_states=fewer, tolerance=1e-4, guide=guide
                )
                part, success, kind = sampled.enumerated, sampled.success, "95 %"
            rows.append(
                {
                    "scenario": name,
                    "policy": policy,
                    "arrival": guide.arrival,
                    "guide_survival": guide.survival,
                    "homotopy": homotopy,
                    "success_low": success[0],
                    "success_high": success[1],
                    "kind": kind,
                    "infeasible": round(part.infeasible, 2),
                }
            )
    return pd.DataFrame(rows).round(DIGITS)


def small_changes(scenario: Scenario) -> Iterator[tuple[str, dict[str, object]]]:
    """Small changes of the calibrated geometry: names and values."""
    yield "as calibrated", {}
    for margin in (0.05, 0.1, 0.15, 0.3):
        yield f"guide.margin = {margin}", {"guide.margin": margin}
    for factor in (0.8, 1.25):
        a_max = round(factor * scenario.guide_a_max, 6)
        yield f"guide.a_max = {a_max:g}", {"guide.a_max": a_max}
    radars = scenario.hazard.radar_positions
    gate = radars[0] - radars[-1]
    along = gate / np.hypot(*gate)
    for label, shift in (("wider", 0.05), ("narrower", -0.05)):
        moved = radars + np.outer([shift, *[0.0] * (len(radars) - 2), -shift], along)
        yield f"gate 0.1 {label}", {"hazard.radars": moved.tolist()}
    directions = {"right": (1, 0), "left": (-1, 0), "up": (0, 1), "down": (0, -1)}
    for name, direction in directions.items():
        moved = radars + 0.05 * np.array(direction)
        yield f"radars 0.05 {name}", {"hazard.radars": moved.tolist()}


def sensitivity(
    scenario: Scenario, report: Report, policies: Sequence[str] = PAPER_POLICIES
) -> pd.DataFrame:
    """Exact success after small changes of the geometry: a row per change, midpoints of bounds.

    Columns: change, the guide's risk and arrival step, a column per policy, and a column
    POLICY_within: whether the bounds, at most 0.01 wide, lie in the paper's interval.
    """
    rows = []
    for name, change in small_changes(scenario):
        report(f"change: {name}")
        moved = scenario.with_values(change) if change else scenario
        guide = plan(moved, certify=False)
        row: dict[str, object] = {"change": name, "risk": guide.risk, "arrival": guide.arrival}
        for policy in policies:
            success = evaluate(moved, policy, 10 * WIDTH, guide=guide).success
            low, high = paper_interval(policy)
            row[policy] = sum(success) / 2
            row[f"{policy}_within"] = low <= success.low and success.high <= high
        rows.append(row)
    return pd.DataFrame(rows).round(4)

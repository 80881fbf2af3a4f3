"""All policies where radars cannot be avoided: success, its upper bound, and times.

Run with the installed package::

    python benchmarks/policies.py            # some minutes
    python benchmarks/policies.py --quick    # two scenarios, wider bounds
    python benchmarks/policies.py --out results/policies    # also as CSV and a figure

Prints two Markdown tables. Success is the middle of proven bounds, where the budget of states
suffices for a width of 0.01, and otherwise (marked ~) that of an interval with 95 % confidence,
what the states leave being sampled. *Planning* is the time until the policy is ready (guide
included), *decision* that of a step per distinct state, the chain's own work included, both in
processor time. Policies that follow a guide get one that members can follow: its own limit on
acceleration is a fifth of theirs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from _timing import print_table

import casswarm as csw
import casswarm.policies
from casswarm import Guide, Scenario
from casswarm._util.numbers import rounded_up
from casswarm.figures import success_chart
from casswarm.results.drawing import FigureFormat
from casswarm.results.folder import ResultsFolder

WIDE = 0.01  # bounds that are wider are replaced by an interval from RUNS runs
RUNS = 4000
COMMAND = "python benchmarks/policies.py --out results/policies"
README = f"""# Policies where radars cannot be avoided

Written by `{COMMAND}`, which takes some minutes; `run.json` records its inputs and the versions.
`docs/policies.md` discusses the results.

![Success probability of every policy in six scenarios](policies.png)

`policies.csv` has a row per scenario and policy:

| column | meaning |
| :-- | :-- |
| scenario, policy | names; scenarios differ from the built-in ones as the benchmark states |
| bound | proven upper bound on the success probability of any policy |
| success_low, success_high | proven bounds if `exact`, else a 95 % interval from {RUNS} runs |
| exact | whether the bounds are proven and at most {WIDE} apart |
| infeasible | mean number of member-steps per run whose soft constraint could not be met |
| failures | mean number of solver failures per run |
| planning_seconds | CPU time until the policy is ready, guide included |
| decision_microseconds | CPU time per step and distinct state, the chain's own work included |
"""
GENTLE = {"guide.a_max": 0.1, "guide.search": "global", "guide.arrival": "any"}
GATE = {
    "target.center": [8.0, 6.5],
    "hazard.radars": [[4.4, 4.6], [4.5, 3.0]],
    "swarm.positions": [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, -0.5]],
}
"""Two radars beside the straight path, which a swarm reaches in half the time of `paper-1`."""

Maker = Callable[[Scenario, Guide], Any]


def cases() -> dict[str, Scenario]:
    """Scenarios in which every path leads past radars, none much safer than the others."""
    hurried = GENTLE | GATE | {"time.t_f": 5.0}
    return {
        "alley": csw.load_scenario("alley"),
        "barricade": csw.load_scenario("barricade"),
        "ring, rates x 3, t_f = 8": csw.load_scenario("ring").with_values(
            GENTLE | {"hazard.alpha_1": 9.0, "time.t_f": 8.0}
        ),
        "gauntlet": csw.load_scenario("gauntlet").with_values(GENTLE),
        "gate, rates x 3, t_f = 5": csw.load_scenario("paper-1").with_values(
            hurried | {"hazard.alpha_1": 12.0}
        ),
        "gate, collisions, rates x 2, t_f = 5": csw.load_scenario("paper-2").with_values(
            hurried | {"hazard.alpha_1": 8.0}
        ),
    }


def makers() -> dict[str, Maker]:
    """Functions that make every policy."""

    def named(name: str, scenario: Scenario, guide: Guide, **options: Any) -> Any:
        return csw.make_policy(name, scenario, guide, **options)

    rules = {
        f"leader, {rule}": partial(named, "leader", leader_selection=rule)
        for rule in ("first", "safest")
    }
    names = [name for name in csw.policies.POLICIES if "mpc" not in name and name != "optimal"]
    names += ["constrained-mpc-3", "leader-mpc-3", "leader-mpc-8"]
    return {name: partial(named, name) for name in names} | rules


def decision_time(scenario: Scenario, policy: Any, guide: Guide) -> float:
    """Microseconds of processor time per step and distinct state, in a thousand runs."""
    options: dict[str, Any] = {"guide": guide, "save_trajectories": 0}
    csw.simulate(scenario, [policy], 10, **options)  # compiled before the clock starts
    started = time.process_time()
    study = csw.simulate(scenario, [policy], 1000, **options)
    return 1e6 * (time.process_time() - started) / float(study.effort["states"].sum())


def row(
    scenario: Scenario, guide: Guide, planned: float, make: Maker, options: dict[str, Any]
) -> dict[str, Any]:
    """Measurements of a policy: a row of the table."""
    started = time.process_time()
    policy = make(scenario, guide)
    planned += time.process_time() - started
    distribution = csw.evaluate(scenario, policy, guide=guide, **options)
    (low, high), exact = distribution.success, True
    if high - low > WIDE:
        (low, high), exact = (
            csw.estimate(scenario, policy, RUNS, tolerance=1e-4, guide=guide).success,
            False,
        )
    return {
        "success_low": low,
        "success_high": high,
        "exact": exact,
        "infeasible": distribution.infeasible,
        "failures": distribution.failures,
        "planning_seconds": planned,
        "decision_microseconds": decision_time(scenario, policy, guide),
    }


def print_tables(table: pd.DataFrame) -> None:
    """Print success by policy and scenario, and the ranges of times over scenarios."""
    columns = {
        name: rows.set_index("policy") for name, rows in table.groupby("scenario", sort=False)
    }
    success = [
        (policy, *(_success(rows.loc[policy]) for rows in columns.values()))
        for policy in table["policy"].unique()
    ]
    bounds = (
        "upper bound",
        *(f"{rounded_up(rows['bound'].iloc[0], 3):.3f}" for rows in columns.values()),
    )
    print_table(("policy", *columns), [*success, bounds])
    print()
    times = table.groupby("policy", sort=False)[["planning_seconds", "decision_microseconds"]]
    low, high = times.min(), times.max()
    print_table(
        ("policy", "planning, CPU seconds", "decision, us a step and state"),
        (
            (
                policy,
                f"{low.loc[policy].iloc[0]:.1f} to {high.loc[policy].iloc[0]:.1f}",
                f"{low.loc[policy].iloc[1]:.0f} to {high.loc[policy].iloc[1]:.0f}",
            )
            for policy in low.index
        ),
    )


def _success(measured: Any) -> str:
    """Middle of bounds, or of an interval (~)."""
    middle = (measured["success_low"] + measured["success_high"]) / 2
    return f"{'' if measured['exact'] else '~'}{middle:.3f}"


def write(path: Path, table: pd.DataFrame, options: dict[str, Any]) -> None:
    """Write policies.csv, policies.png, README.md and run.json, the record of how."""
    folder = ResultsFolder.create(COMMAND, None, path, FigureFormat(dpi=130))
    folder.write_tables(policies=table.round(6))
    folder.write_figures({"policies": partial(success_chart, table)})
    folder.write_file("README.md", README)
    folder.write_record({}, options | {"runs": RUNS, "decision_runs": 1000, "seed": 0})


def upper_bound(scenario: Scenario, work: float = 1.5e8) -> float:
    """The bound on the success of every policy, rounded up to the digits of the table."""
    return rounded_up(csw.success_bound(scenario, max_work=work).value, 6)


def renew_bounds(path: Path) -> None:
    """Compute the column of bounds again, and draw the figure with it."""
    table = pd.read_csv(path / "policies.csv")
    bounds = {name: upper_bound(scenario) for name, scenario in cases().items()}
    table["bound"] = table["scenario"].map(bounds)
    folder = ResultsFolder.create(COMMAND, None, path, FigureFormat(dpi=130))
    folder.write_tables(policies=table)
    folder.write_figures({"policies": partial(success_chart, table)})


def main() -> None:
    """Print two tables; with --out FOLDER, also write table, figure, README and run.json.

    With --bounds FOLDER only the bounds there are computed again.
    """
    if "--bounds" in sys.argv:
        renew_bounds(Path(sys.argv[sys.argv.index("--bounds") + 1]))
        return
    quick = "--quick" in sys.argv
    options: dict[str, Any] = {"tolerance": 1e-2 if quick else 1e-3, "max_states": 20_000}
    rows = []
    for name, scenario in list(cases().items())[: 2 if quick else None]:
        started = time.process_time()
        guide = csw.plan(scenario)
        planned = time.process_time() - started
        bound = upper_bound(scenario, 1e6 if quick else 1.5e8)
        for policy, make in makers().items():
            measured = row(scenario, guide, planned, make, options)
            rows.append({"scenario": name, "policy": policy, "bound": bound} | measured)
            print(f"{name}: {policy}", file=sys.stderr)
    print_tables(pd.DataFrame(rows))
    if "--out" in sys.argv:
        write(Path(sys.argv[sys.argv.index("--out") + 1]), pd.DataFrame(rows), options)


if __name__ == "__main__":
    main()

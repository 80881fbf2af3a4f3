"""What receding-horizon formations cost, and what they gain.

Run with the installed package::

    python benchmarks/mpc.py speed          # against Ipopt on the same problems
    python benchmarks/mpc.py value          # success and infeasible member-steps against H
    python benchmarks/mpc.py value --quick  # fewer states and runs

`speed` prints microseconds per state (n = 5, states of simulated runs of the policy itself) and the
ratio to Ipopt, medians of passes in turn; then the time of exact evaluation and of a thousand
runs. `value` prints a Markdown table, and writes mpc.csv and mpc.png in the current folder: bounds
by exact evaluation, where its states suffice for a width of 0.01, and otherwise (marked ~)
intervals with 95 % confidence of simulated runs. ``casswarm evaluate SCENARIO --policy leader-mpc-3
--aggregation-tol 1e-6`` gives the same bounds.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from _timing import arguments, in_turn, timed

import casswarm as csw
from casswarm import make_policy
from casswarm.figures import mpc_chart, save
from casswarm.formation import Auto
from casswarm.nlp.program import Instances, Nlp
from casswarm.nlp.solution import BatchSolution
from casswarm.solvers import Ipopt

STEPS = (1, 2, 3, 5, 8)
SCENARIOS = ("paper-1", "paper-2", "wall", "ring", "crossfire", "gauntlet")
WIDE = 0.01


@dataclass(frozen=True)
class Recorder(Auto):
    """The default solver, which records its problems."""

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Note the instances, and solve them."""
        ASKED.append((nlp, instances))
        return super().solve_batch(nlp, instances)


ASKED: list[tuple[Nlp, Instances]] = []


def problems(scenario: csw.Scenario, name: str, runs: int) -> list[tuple[Nlp, Instances]]:
    """The problems of simulated runs, a batch a step."""
    guide = csw.plan(scenario, certify=False)
    ASKED.clear()
    csw.simulate(scenario, [make_policy(name, scenario, guide, Recorder())], runs, guide=guide)
    return list(ASKED)


def one_speed(name: str, problem: str, steps: int, runs: int, few: int) -> str:
    """A row: times a state of `auto` and of Ipopt on the same problems, and the differences."""
    scenario = csw.load_scenario(name)
    recorded = problems(scenario, named(problem, steps), runs)
    states = sum(len(instances) for _, instances in recorded)
    rng = np.random.default_rng(0)
    chosen = []
    for k in rng.choice(len(recorded), few, p=[len(i) / states for _, i in recorded]):
        nlp, instances = recorded[k]
        row = int(rng.integers(len(instances)))
        chosen.append((nlp, instances[row : row + 1]))
    auto, ipopt = Auto(), Ipopt()

    def batches() -> list[BatchSolution]:
        return [auto.solve_batch(nlp, instances) for nlp, instances in recorded]

    def singles() -> list[BatchSolution]:
        return [ipopt.solve_batch(nlp, instances) for nlp, instances in chosen]

    found, exact = batches(), singles()  # and all is compiled
    ours, theirs, ratio = in_turn(batches, singles, 3)
    ours, theirs, ratio = ours / states, theirs / few, ratio * states / few
    same = [auto.solve_batch(nlp, instances) for nlp, instances in chosen]
    f = np.array([s.objective[0] for s in same])
    g = np.array([s.objective[0] if s.success[0] else np.inf for s in exact])
    fallbacks = sum(int(s.used_fallback.sum()) for s in found)
    failed = sum(int((~s.success).sum()) for s in found)
    return (
        f"| {name} | {problem} | {steps} | {states} | {1e6 * ours:.0f} µs | {1e3 * theirs:.1f} ms "
        f"| {ratio:.0f} x | {fallbacks} | {failed} | {int((f > g * (1 + 1e-6)).sum())}, "
        f"{int((f < g * (1 - 1e-6)).sum())} of {few} |"
    )


def named(policy: str, steps: int) -> str:
    return policy if steps == 1 else f"{policy}-mpc-{steps}"


def speed(quick: bool) -> None:
    """Print the tables of times."""
    runs, few = (60, 10) if quick else (300, 30)
    print(
        "| scenario | problem | H | states | `auto` | Ipopt | ratio | fallbacks | failures | ",
        end="",
    )
    print("worse, better |")
    print("| --- | --- " + "| --: " * 8 + "|")
    for name, problem in (("paper-1", "leader"), ("paper-1", "constrained"), ("paper-2", "leader")):
        for steps in STEPS:
            print(one_speed(name, problem, steps, runs, few), flush=True)
    print()
    scenario = csw.load_scenario("paper-1")
    guide = csw.plan(scenario, certify=False)
    for problem in ("leader", "constrained"):
        policy = make_policy(named(problem, 3), scenario, guide)
        started = time.perf_counter()
        distribution = csw.evaluate(scenario, policy, 1e-2, guide=guide)
        took = time.perf_counter() - started
        low, high = distribution.success
        print(
            f"{policy.name}: {low:.4f} to {high:.4f}, {distribution.states} states, {took:.1f} s\n"
        )
        policy = make_policy(named(problem, 8), scenario, guide)
        took = timed(lambda policy=policy: csw.simulate(scenario, [policy], 1000, guide=guide)).wall
        print(f"{policy.name}: 1000 runs in {took:.1f} s\n")


def measured(scenario: csw.Scenario, guide: csw.Guide, name: str, quick: bool) -> dict[str, Any]:
    """A policy's success, as bounds or an interval, and its counts per run."""
    # with collisions, problems are slow and bounds wide: fewer states there, and more runs
    collides = scenario.hazard_table.kind != "saturation"
    most = (3_000 if quick else 20_000) // (10 if collides else 1)
    options: dict[str, Any] = {"guide": guide, "aggregation_tol": 1e-6, "max_states": most}
    policy = make_policy(name, scenario, guide)
    distribution = csw.evaluate(scenario, policy, 5e-3, **options)
    (low, high), mark, states = distribution.success, "", distribution.states
    if high - low > WIDE:
        runs = (100 if quick else 500) if collides else (500 if quick else 2000)
        study = csw.simulate(scenario, [policy], runs, guide=guide, save_trajectories=0)
        row = study.summary.iloc[0]
        low, high, mark = row["success_low"], row["success_high"], "~ "
        success, infeasible = row["success"], row["infeasible"] / runs
        failures, fallbacks = row["solver_failures"] / runs, row["fallbacks"] / runs
        states = int(study.effort["states"].iloc[0])
    else:
        success, infeasible = 0.5 * (low + high), distribution.infeasible
        failures, fallbacks = distribution.failures, np.nan
    return {
        "success": success,
        "success_low": low,
        "success_high": high,
        "mark": mark,
        "infeasible": infeasible,
        "failures": failures,
        "fallbacks": fallbacks,
        "states": states,
    }


def value(quick: bool) -> None:
    """Print the table of success over the horizon, and draw it."""
    rows = []
    print("| scenario | policy | " + " | ".join(f"H = {steps}" for steps in STEPS) + " |")
    print("| --- | --- " + "| --- " * len(STEPS) + "|", flush=True)
    for name in SCENARIOS:
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for problem in ("leader", "constrained"):
            columns = []
            for steps in STEPS:
                started = time.process_time()
                found = measured(scenario, guide, named(problem, steps), quick)
                took = time.process_time() - started
                rows.append({"scenario": name, "policy": problem, "horizon": steps, **found})
                columns.append(
                    f"{found['mark']}{found['success_low']:.3f} to {found['success_high']:.3f}; "
                    f"{found['infeasible']:.1f}"
                )
                print(f"{name}, {problem}, H = {steps}: {took:.0f} s, {found}", file=sys.stderr)
                pd.DataFrame(rows).to_csv("mpc.csv", index=False)
            print(f"| {name} | {problem} | " + " | ".join(columns) + " |", flush=True)
    save(mpc_chart(pd.DataFrame(rows)), Path("mpc.png"))


PARTS = {"speed": speed, "value": value}


def main() -> None:
    """Print the chosen tables, or both."""
    options = arguments(__doc__, PARTS)
    for part in options.parts:
        PARTS[part](options.quick)


if __name__ == "__main__":
    main()

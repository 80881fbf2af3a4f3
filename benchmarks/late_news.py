"""Success over the delay of news, where radars cannot be avoided.

Run with the installed package::

    python benchmarks/late_news.py                          # some minutes
    python benchmarks/late_news.py --out results/late-news  # also as CSV and a figure

The scenarios are those of ``benchmarks/policies.py``. Success has proven bounds of width 0.001 if
the budget of states suffices, and otherwise (marked ~) an interval with 95 % confidence. A joint
plan does not look at losses: its exact law is that of every delay.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from _timing import print_table
from matplotlib.figure import Figure
from policies import cases

import casswarm as csw
from casswarm.figures import sweep_lines
from casswarm.results.drawing import FigureFormat
from casswarm.results.folder import ResultsFolder

COMMAND = "python benchmarks/late_news.py --out results/late-news"
KEY = "information.delay"
DELAYS: tuple[int | str, ...] = (0, 1, 3, 10, "never")
POLICIES = ("leader", "constrained", "joint", "joint-replanning")
RUNS = 4000
STATES = {"leader": 4_000_000, "constrained": 4_000_000, "joint-replanning": 400_000}
"""Budgets of the exact laws: a state of the tree of plans takes 30 times as long."""


def row(scenario: csw.Scenario, policy: csw.Policy, guide: csw.Guide) -> dict[str, Any]:
    """Success of a policy in a scenario with a delay."""
    started, most = time.process_time(), STATES[policy.name]
    law = csw.evaluate(scenario, policy, 1e-3, max_states=most, guide=guide)
    (low, high), exact, states = law.success, law.complete, law.states
    if not exact:
        estimate = csw.estimate(scenario, policy, RUNS, max_states=20_000, guide=guide)
        low, high = estimate.success
    seconds = time.process_time() - started
    return {"success_low": low, "success_high": high, "exact": exact} | {
        "states": states,
        "seconds": seconds,
    }


def rows_of(name: str, scenario: csw.Scenario) -> list[dict[str, Any]]:
    """Rows of a scenario: every policy with every delay."""
    guide = csw.plan(scenario, certify=False)
    plan = csw.plan_swarm(scenario, guide=guide)
    assert plan.success is not None
    assert plan.bound is not None
    rows = []
    for policy in POLICIES:
        for delay in DELAYS:
            late = scenario.replace(information={"delay": delay})
            made = csw.make_policy(policy, late, guide)
            if policy == "joint":
                low, high = plan.success
                found = {"success_low": low, "success_high": high, "exact": True}
            else:
                found = row(late, made, guide)
            case = {"scenario": name, "policy": policy, KEY: delay, "bound": plan.bound.value}
            rows.append(case | found)
            print(rows[-1], flush=True)
    return rows


def figure(table: pd.DataFrame) -> Figure:
    """Success over the delay, a panel per scenario, with the bound of all policies."""
    drawn = table.assign(success=(table.success_low + table.success_high) / 2, status="ok")
    drawn[KEY] = drawn[KEY].astype(str)
    fig, axes = plt.subplots(2, 3, figsize=(9.5, 5.6), sharey=True, layout="constrained")
    for panel, (name, rows) in zip(axes.flat, drawn.groupby("scenario", sort=False), strict=True):
        sweep_lines(rows[rows["policy"] != "joint"], KEY, None, ax=panel)
        for policy, style in (("joint", "-"), ("bound of all policies", "--")):
            column = "bound" if style == "--" else "success"
            value = float(rows.loc[rows["policy"] == "joint", column].iloc[0])
            panel.axhline(value, color="0.4", linestyle=style, linewidth=1.0, label=policy)
        panel.set_title(f"{name}", fontsize="small")
        panel.set_xlabel("delay of news, in steps")
        panel.get_legend().remove()
    handles, labels = axes.flat[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=5)
    return fig


def main() -> None:
    """Print the table; with --out FOLDER, also write it, with a figure and run.json."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", help="one of the scenarios")
    options = parser.parse_args()
    chosen = {name: s for name, s in cases().items() if options.only in (None, name)}
    table = pd.DataFrame([one for name, s in chosen.items() for one in rows_of(name, s)])
    print_table(tuple(table.columns), table.to_numpy().tolist())
    if options.out is not None:
        folder = ResultsFolder.create(COMMAND, None, options.out, FigureFormat(dpi=110))
        folder.write_tables(**{"late-news": table.round(6)})
        folder.write_figures({"late-news": partial(figure, table)})
        folder.write_record({}, {"runs": RUNS, "max_states": STATES, "tolerance": 1e-3})


if __name__ == "__main__":
    main()

"""Fixed and feedback guides compared: bounds of the success probability.

Run with the installed package::

    python benchmarks/feedback.py            # some minutes
    python benchmarks/feedback.py --quick    # wider bounds

Prints a Markdown table: bounds, where forty thousand states suffice for one of width 0.01, and
otherwise (marked ~) intervals with 95 % confidence, what the states leave being sampled. It is
what ``casswarm evaluate`` gives, too, for the scenario and the ``--set`` options of `cases`, with
``--aggregation-tol 1e-6``. The single agent starts at the centre of the swarm: its survival
along the fixed guide, and along the feedback guide.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from _timing import arguments, print_table

import casswarm as csw
from casswarm import Guide, Scenario

POLICIES = ("leader", "leader-feedback", "constrained", "constrained-feedback")
BEST = {"guide.search": "global", "guide.arrival": "any"}
WIDE = 0.01
APART = [(0.0, 0.0), (2.0, -1.0), (-1.0, 2.0), (-2.0, -1.0), (1.0, -2.0)]


def cases() -> dict[str, Scenario]:
    """Scenarios in which members are off the guide, and some in which they are not."""
    paper = csw.load_scenario("paper-1").with_values(BEST)
    sharp = {"guide.acceleration_limited": False}
    found = {
        "paper-1, the best guide": paper,
        "paper-2, the best guide": csw.load_scenario("paper-2").with_values(BEST),
        "paper-1, members start apart": paper.with_values({"swarm.positions": APART}),
        "paper-1, the guide knows no a_max": paper.with_values(sharp),
        "the same, a_max = 0.1": paper.with_values(sharp | {"swarm.a_max": 0.1}),
    }
    return found | {
        name: csw.load_scenario(name) for name in ("wall", "ring", "crossfire", "gauntlet")
    }


def single_agent(scenario: Scenario, guide: Guide) -> float:
    """Survival of one agent along the feedback guide from where the fixed guide starts."""
    policy = csw.make_policy("leader-feedback", scenario)
    position, velocity = guide.positions[:1, None], guide.velocities[:1, None]
    risk, alive = 0.0, np.ones((1, 1), bool)
    for step in range(scenario.n_steps):
        velocity = policy.velocities(step, position, velocity, alive)
        position = position + scenario.time.dt * velocity
        risk += scenario.time.dt * float(scenario.hazard.single_agent_rates(position[0, 0]))
        if scenario.target.contains(position[0, 0]):
            return float(np.exp(-risk))
    return 0.0


def row(name: str, scenario: Scenario, options: dict[str, Any]) -> list[str]:
    """A scenario's survival of a single agent, and its policies' success."""
    guide = csw.plan(scenario, certify=False)
    options = {"tolerance": 1e-4, "guide": guide, "aggregation_tol": 1e-6} | options
    columns = [name, f"{guide.survival:.3f}", f"{single_agent(scenario, guide):.3f}"]
    for policy in POLICIES:
        started = time.process_time()
        exact = csw.evaluate(scenario, policy, **options)
        (low, high), mark = exact.success, ""
        if high - low > WIDE:
            estimate = csw.estimate(scenario, policy, 2000, **options)
            (low, high), mark = estimate.success, "~ "
        columns.append(f"{mark}{low:.4f} to {high:.4f}")
        took = time.process_time() - started
        print(f"{name}, {policy}: {exact.states} states, {took:.1f} s", file=sys.stderr)
    return columns


def main() -> None:
    """Print the table."""
    quick = arguments(__doc__).quick
    options: dict[str, Any] = {
        "tolerance": 1e-2 if quick else 1e-3,
        "max_states": 20_000 if quick else 40_000,
    }
    rows = (row(name, scenario, options) for name, scenario in cases().items())
    print_table(("scenario", "single agent: fixed guide", "feedback", *POLICIES), rows)


if __name__ == "__main__":
    main()

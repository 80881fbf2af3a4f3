"""What a guide that waits (``guide.max_wait``) changes in both policies that follow it.

Run with the installed package::

    python benchmarks/waiting_guide.py            # 2000 runs each, a few minutes
    python benchmarks/waiting_guide.py --quick    # 100 runs each

The guide is planned for the scenario's own t_f, and the runs may take 1.4 times as long, so that it
has time to wait. In the scenarios marked *too tight*, the guide does not respect the members' limit
of acceleration, and leaders fall behind. All columns of a row see the same random numbers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from _timing import arguments, print_table

import casswarm as csw

TIGHT = {"guide.acceleration_limited": False}
CASES: tuple[tuple[str, dict[str, Any]], ...] = tuple(
    (name, changes) for name in ("alley", "gauntlet", "paper-1", "ring") for changes in ({}, TIGHT)
)
STEPS = (0, 1, 2, 3, 5, 8)


def row(name: str, changes: dict[str, Any], policy: str, runs: int) -> list[str]:
    """Success of one policy for every number of steps that the guide may wait."""
    planned = csw.load_scenario(name).with_values(changes)
    guide = csw.plan(planned, certify=False)
    scenario = planned.with_values({"time.t_f": 1.4 * planned.time.t_f})
    made = csw.make_policy(policy, scenario, guide)
    policies = [replace(made, max_wait=steps, name=f"{steps}") for steps in STEPS]
    study = csw.simulate(scenario, policies, runs, guide=guide)
    spare = f"{scenario.n_steps - guide.arrival}"
    success = [f"{value:.3f}" for value in study.summary["success"]]
    return [name + (", too tight" if changes else ""), policy, spare, *success]


def main() -> None:
    """Print a row for every scenario and policy."""
    runs = 100 if arguments(__doc__).quick else 2000
    rows = [row(*case, policy, runs) for case in CASES for policy in ("leader", "constrained")]
    print_table(["scenario", "policy", "spare steps", *(f"w = {w}" for w in STEPS)], rows)


if __name__ == "__main__":
    main()

"""What the weight of followers, and displacements of starts, change in leader protection.

Run with the installed package::

    python benchmarks/follower_weight.py            # 6000 runs each, a few minutes
    python benchmarks/follower_weight.py --quick    # 300 runs each

All weights of a row see the same random numbers, so differences are paired run by run. The second
table pairs every weight with the policy ``constrained``, which has no such weight. The third one
replaces the random displacements of the starts of every formation problem by others.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from _timing import arguments, print_table

import casswarm as csw
from casswarm.formation import projected_gradient

CASES = (("paper-2", "local"), ("paper-2", "global"), ("gauntlet", "global"))
"""Scenario, and search of the guide."""

WEIGHTS = (0.0, 0.001, 0.01, 0.1, 1.0)


def differences(name: str, search: str, runs: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Success of every weight, and differences of all pairs."""
    scenario = csw.load_scenario(name).with_values({"guide.search": search})
    guide = csw.plan(scenario, certify=False)
    policies = [csw.make_policy("leader", scenario, guide)]
    policies += [
        replace(policies[0], follower_weight=weight, name=f"weight {weight:g}")
        for weight in WEIGHTS
        if weight != policies[0].follower_weight
    ]
    policies.append(csw.make_policy("constrained", scenario, guide))
    study = csw.simulate(scenario, policies, runs=runs, guide=guide)
    return study.summary, study.paired


@contextmanager
def displaced(seed: int) -> Iterator[None]:
    """Within it, starts have other random displacements than the default's."""
    original = projected_gradient.start_displacements

    def other(initial: int, members: int) -> np.ndarray:
        shape = original(initial, members).shape
        found = np.random.default_rng([seed, members]).normal(size=shape)
        found[0] = 0.0  # the first start is the initial guess
        return found

    projected_gradient.start_displacements = other
    try:
        yield
    finally:
        projected_gradient.start_displacements = original


def changed_runs(name: str, search: str, runs: int, seeds: int = 4) -> list[list[str]]:
    """Success with other displacements of the starts, and how many runs end otherwise."""
    scenario = csw.load_scenario(name).with_values({"guide.search": search})
    guide = csw.plan(scenario, certify=False)
    rows, default = [], csw.simulate(scenario, "leader", runs, guide=guide).runs["success"]
    for seed in range(1, seeds + 1):
        with displaced(seed):
            found = csw.simulate(scenario, "leader", runs, guide=guide).runs["success"]
        gained, lost = int((found & ~default).sum()), int((default & ~found).sum())
        case = f"{name}, {search} guide"
        rows.append([case, f"{seed}", f"{default.mean():.4f}", f"{found.mean():.4f}"])
        rows[-1] += [f"{gained}", f"{lost}"]
    return rows


def difference(row: dict[str, Any]) -> list[str]:
    """Success of the second policy of a pair minus that of the first, and its interval."""
    low, high = -row["difference_high"], -row["difference_low"]
    return [f"{-row['difference']:+.4f}", f"{low:+.4f} to {high:+.4f}"]


def main() -> None:
    """Print a row for every scenario and weight, and for all other displacements."""
    options = arguments(__doc__)
    to_default: list[list[str]] = []
    to_constrained: list[list[str]] = []
    for name, search in CASES:
        summary, paired = differences(name, search, 300 if options.quick else 6000)
        found = summary.set_index("policy")["success"]
        case, default = f"{name}, {search} guide", f"{found['leader']:.4f}"
        to_default.append([case, "0.01 (default)", default, "", ""])
        for row in paired.to_dict("records"):
            first, second = (row[key].removeprefix("weight ") for key in ("first", "second"))
            if second == "constrained":
                to_constrained.append([case, first, *difference(row)])
            elif first == "leader":
                to_default.append([case, second, f"{found[row['second']]:.4f}", *difference(row)])
    head = ["scenario", "weight", "success", "difference", "95 % interval"]
    print_table(head, to_default)
    print_table(["scenario", "weight", "constrained - leader", "95 % interval"], to_constrained)
    rows = [row for case in CASES for row in changed_runs(*case, 100 if options.quick else 2000)]
    print_table(["scenario", "seed", "default", "success", "gained", "lost"], rows)


if __name__ == "__main__":
    main()

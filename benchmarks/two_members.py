"""Brackets of the optimal success probability of two members.

Run with the installed package::

    OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/two_members.py
    python benchmarks/two_members.py alley gauntlet    # scenarios whose names begin so

The scenarios are those of ``benchmarks/policies.py`` with their first two members. Prints a
Markdown table: the bracket with the scenario's limit of acceleration and without it, the policies
that come next, today's bound, wall-clock seconds, and the nodes of the largest grid.
"""

from __future__ import annotations

import sys
import time

from _timing import print_table
from policies import cases

import casswarm as csw
from casswarm._util.numbers import rounded_up
from casswarm.scenario.variations import with_parameters

TIME_LIMIT = 60.0  # for both upper ends


def row(name: str, scenario: csw.Scenario) -> dict[str, str]:
    """A row of the table."""
    guide = csw.plan(scenario, certify=False)
    joint = csw.evaluate(scenario, "joint", 0.0, guide=guide).success.low
    leader = csw.evaluate(scenario, "leader", 1e-4, guide=guide).success.low
    started = time.perf_counter()
    found = csw.optimal_value(scenario, time_limit=TIME_LIMIT, guide=guide)
    seconds = time.perf_counter() - started
    levels = [level for bound in found.bounds for level in bound.levels]
    print(name, found, [bound.reason for bound in found.bounds], file=sys.stderr, flush=True)
    return {
        "scenario": name,
        "leader": f"{leader:.4f}",
        "joint": f"{joint:.4f}",
        "optimal value": f"{found.success.low:.4f} to {found.success.high:.4f}",
        "width": f"{found.success.width:.4f}",
        "without a_max": f"{found.unlimited.low:.4f} to {found.unlimited.high:.4f}",
        "its width": f"{found.unlimited.width:.4f}",
        "success_bound": f"{rounded_up(csw.success_bound(scenario).value):.4f}",
        "seconds": f"{seconds:.0f}",
        "of that, bounds": f"{sum(bound.levels[-1].seconds for bound in found.bounds):.0f}",
        "largest grid": f"{max(level.nodes for level in levels) / 1e6:.0f} million",
    }


def main(chosen: list[str]) -> None:
    """Print the table of all scenarios, or of those whose names begin like one that is given."""
    rows = [
        row(name, with_parameters(scenario, {"n": 2}))
        for name, scenario in cases().items()
        if not chosen or any(name.startswith(prefix) for prefix in chosen)
    ]
    print_table(list(rows[0]), [list(values.values()) for values in rows])


if __name__ == "__main__":
    main(sys.argv[1:])

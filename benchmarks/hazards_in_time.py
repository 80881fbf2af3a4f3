"""Processor time of scenarios whose radars move or switch, relative to the same radars at rest.

Run with the installed package::

    python benchmarks/hazards_in_time.py

Each row has medians over pairs that are measured in turn, after the first, which compiles. With
``refined`` the steps are 8 times as fine.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

from _timing import print_table

import casswarm as csw

_PAIRS = 7


def at_rest(scenario: csw.Scenario) -> csw.Scenario:
    """The scenario with its radars where they are at time 0, always active."""
    table = scenario.hazard_table
    places = [radar.position or radar.path[0][1:] for radar in table.radar]
    radars = [list(place) for place in (*table.radars, *places)]
    return scenario.with_values({"hazard.radar": [], "hazard.radars": radars})


def calls(scenario: csw.Scenario, fine: bool, guide: csw.Guide) -> dict[str, Callable[[], object]]:
    """What is measured, by name: runs with the same guide, which has a number of steps."""
    with_guide = {
        "simulate": lambda: csw.simulate(scenario, "leader", 5000, guide=guide),
        "evaluate": lambda: csw.evaluate(scenario, "leader", 1e-3, guide=guide),
    }
    if fine:
        return with_guide
    guides = {
        "plan, not certified": lambda: csw.plan(scenario, certify=False),
        "plan": lambda: csw.plan(scenario),
    }
    return guides | with_guide


def main() -> None:
    """Measure all and print the table."""
    rows = []
    for name in ("patrol", "blink"):
        for fine in (False, True):
            moving = csw.load_scenario(name).refined(8 if fine else 1)
            guide = csw.plan(moving, certify=False, search="local" if fine else None)
            rest = calls(at_rest(moving), fine, guide).items()
            pairs = zip(rest, calls(moving, fine, guide).values(), strict=True)
            for (what, rest), call in pairs:
                seconds = [[_seconds(each) for each in (rest, call)] for _ in range(_PAIRS + 1)][1:]
                medians = [statistics.median(column) for column in zip(*seconds, strict=True)]
                ratio = statistics.median(b / a for a, b in seconds)
                rows.append((name + ", refined" * fine, what, *medians, ratio))
    print_table(("scenario", "call", "at rest, s", "in time, s", "ratio"), rows)


def _seconds(call: Callable[[], object]) -> float:
    started = time.process_time()
    call()
    return time.process_time() - started


if __name__ == "__main__":
    main()

"""Mixtures of guides for hazards that are not known: value, proven gap, time and memory.

Run with the installed package::

    python benchmarks/unknown_hazards.py             # 20 random geometries, two to four cases
    python benchmarks/unknown_hazards.py --count 5

In every geometry, cases differ by the places of some radars. Guides have the limit of speed only,
so that the bound is not loose for another reason.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time

import numpy as np
from _timing import print_table

import casswarm as csw

AMBIGUITIES = ("worst", ("cvar", 0.6), ("tv", 0.5))


def geometry(seed: int) -> csw.Scenario:
    """Random radars between start and target, some of them at other places in each case."""
    rng = np.random.default_rng(seed)
    common = rng.uniform((2.0, -4.0), (8.0, 4.0), size=(int(rng.integers(1, 6)), 2))
    cases = [
        {
            "weight": float(rng.uniform(0.5, 2.0)),
            "radars": [*common.tolist(), *rng.uniform((2.5, -2.5), (7.5, 2.5), (2, 2)).tolist()],
        }
        for _ in range(2 + seed % 3)
    ]
    data = {
        "name": f"geometry-{seed}",
        "swarm": {"positions": [[0.0, 0.0]], "v_max": 2.0, "a_max": 0.5, "velocity": "guide"},
        "target": {"center": [10.0, 0.0], "radius": 0.5},
        "time": {"dt": 0.33, "t_f": float(rng.uniform(6.0, 9.0))},
        "hazard": {
            "kind": "saturation",
            "alpha_1": float(rng.uniform(1.0, 4.0)),
            "alpha_2": 3.0,
            "alpha_3": 4.0,
            "case": cases,
        },
        "guide": {"search": "global", "arrival": "any", "acceleration_limited": False},
    }
    return csw.Scenario.from_data(data)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    csw.plan(geometry(0), ambiguity="worst")  # compiles
    rows = []
    for seed in range(parser.parse_args().count):
        scenario, ambiguity = geometry(seed), AMBIGUITIES[seed // 3 % 3]
        started = time.perf_counter()
        mixed = csw.plan(scenario, ambiguity=ambiguity, time_limit=10.0)  # type: ignore[call-overload]
        seconds = time.perf_counter() - started
        assert mixed.bound is not None
        levels = mixed.bound.levels
        rows.append(
            (
                seed,
                len(scenario.cases),
                str(mixed.ambiguity),
                f"{mixed.value.low:.4f}",
                f"{mixed.value.high:.4f}",
                f"{100 * mixed.gap:.2f} %",
                f"{mixed.pure_value:.4f}",
                f"{mixed.known_value:.4f}",
                len(mixed.paths),
                f"{seconds:.1f}",
                f"{mixed.bound.seconds:.1f}",
                max(level.nodes * level.beliefs for level in levels),
                f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB",
            )
        )
        print(rows[-1], file=sys.stderr, flush=True)
    header = ("seed", "cases", "ambiguity", "value", "at most", "gap", "pure", "known", "paths")
    print_table((*header, "seconds", "of them bound", "values", "memory"), rows)


if __name__ == "__main__":
    main()

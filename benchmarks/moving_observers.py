"""The first example of Cartee, Lai, Song and Vladimirsky: a game against two moving observers.

Run with the installed package::

    python benchmarks/moving_observers.py              # steps of 0.04
    python benchmarks/moving_observers.py --steps 100

*Time-dependent surveillance-evasion games* (arXiv 1903.01332): an evader crosses the unit square at
speed 1 from (0.1, 0.1) to (0.9, 0.9). One of two observers, on circles of their own, watches with
the rate 1 / (r^2 + 0.1), and the evader does not know which. The observers' equilibrium is
(0.67, 0.33) in the paper. Here the game is in discrete time, to a small disc around the target.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
from _timing import print_table

import casswarm as csw

OBSERVERS = ((0.3, 0.8, 0.12, 0.12), (0.9, 0.1, -0.08, -0.08))
"""Centre, and radius of each coordinate, of the observers' circles."""

DURATION, RADIUS = 2.0, 0.02


def place(orbit, time):  # type: ignore[no-untyped-def]
    """Where an observer is."""
    x, y, a, b = orbit
    return x + a * np.cos(2 * np.pi * time), y + b * np.sin(2 * np.pi * time)


def watched(positions, alive, time, orbit):  # type: ignore[no-untyped-def]
    """Rates of members that an observer watches."""
    del alive
    x, y = place(orbit, time)
    return 1.0 / ((positions[:, 0] - x) ** 2 + (positions[:, 1] - y) ** 2 + 0.1)


def _lower_bound(lower, upper, time, orbit):  # type: ignore[no-untyped-def]
    """Rates at the corners of boxes that are the farthest away."""
    center = np.array(place(orbit, time))
    farthest = np.maximum(np.abs(lower - center), np.abs(upper - center))
    return 1.0 / ((farthest**2).sum(axis=-1) + 0.1)


watched.lower_bound = _lower_bound  # type: ignore[attr-defined]


def scenario(steps: int) -> csw.Scenario:
    """The game with so many steps."""
    dt = DURATION / steps
    return csw.Scenario.from_data(
        {
            "name": "moving-observers",
            "swarm": {"positions": [[0.1, 0.1]], "v_max": 1.0, "a_max": 1.0, "speed": "disc"},
            "target": {"center": [0.9, 0.9], "radius": RADIUS},
            "time": {"dt": dt, "t_f": DURATION + dt / 2},
            "hazard": {
                "kind": watched,
                "case": [{"parameters": {"orbit": list(orbit)}} for orbit in OBSERVERS],
            },
            "guide": {"acceleration_limited": False, "margin": 1e-6},
        }
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, nargs="+", default=[50])
    rows = []
    for steps in parser.parse_args().steps:
        started = time.perf_counter()
        options = {"ambiguity": "worst", "objective": "risk", "gap": 0.005, "time_limit": 300.0}
        mixed = csw.plan(scenario(steps), **options)
        low, high = mixed.value
        prior = ", ".join(f"{q:.3f}" for q in mixed.worst_prior)
        seconds = time.perf_counter() - started
        rows.append(
            (
                steps,
                prior,
                f"{low:.4f}",
                f"{high:.4f}",
                f"{100 * mixed.gap:.2f} %",
                len(mixed.paths),
                f"{seconds:.0f}",
            )
        )
        print(rows[-1], file=sys.stderr, flush=True)
    header = ("steps", "equilibrium", "risk at least", "at most", "gap", "paths", "seconds")
    print_table(header, rows)


if __name__ == "__main__":
    main()

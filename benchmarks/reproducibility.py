"""Success by the paper's method after shifts of the initial positions by the last digits.

Success that depends on them has no definite value: the projected gradient then follows another
course in every arithmetic. With common random numbers, other policies do not change at all::

    python benchmarks/reproducibility.py
"""

from __future__ import annotations

import sys

import casswarm as csw

POLICIES = ("naive", "constrained", "leader")
SHIFTS = (0.0, 1e-12, 1e-9, 1e-7, 1e-6)
RUNS = 4000


def shifted(scenario: csw.Scenario, shift: float) -> csw.Scenario:
    """Scenario whose member k = 1, 2, ... starts k times the shift farther east."""
    positions = [[x + k * shift, y] for k, (x, y) in enumerate(scenario.swarm.positions, start=1)]
    return scenario.with_values({"swarm.positions": positions})


def main(names: list[str]) -> None:
    """Print a row per scenario and shift."""
    print(f"{'scenario':10s} shift " + "".join(f"{name:>13s}" for name in POLICIES))
    for name in names:
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, "projected-gradient", certify=False)
        for shift in SHIFTS:
            study = csw.simulate(
                shifted(scenario, shift),
                list(POLICIES),
                RUNS,
                guide=guide,
                solver="projected-gradient",
            )
            row = "".join(f"{share:13.4f}" for share in study.summary["success"])
            print(f"{name:10s} {shift:5.0e} {row}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["paper-1", "paper-2"])

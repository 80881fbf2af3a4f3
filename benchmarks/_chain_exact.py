"""Exact distributions of the chain: states with and without a lattice, and against Monte Carlo."""

from __future__ import annotations

from functools import partial
from typing import Any

from _timing import timed

import casswarm as csw
from casswarm.studies.simulation import PAPER_POLICIES

Rows = list[dict[str, Any]]
Z = 1.959964  # the 97.5 % quantile of the normal distribution

TOLERANCE = 1e-3
SCENARIOS = ("paper-1", "paper-2", "ring", "gauntlet", "wall", "alley", "crossfire", "barricade")
COARSE = 2.0**-8  # spacing of a coarse lattice, in v_max dt


PREDICTED = (
    ("paper-1", "leader", 1e-3),
    ("paper-1", "leader", 1e-5),
    ("paper-1", "constrained", 1e-3),
    ("paper-1", "naive", 1e-3),
    ("ring", "leader", 1e-3),
    ("gauntlet", "leader", 1e-2),
    ("alley", "leader", 1e-3),
    ("barricade", "naive", 1e-4),
    ("crossfire", "constrained", 1e-2),
    ("wall", "leader", 1e-3),
    ("companions", "leader", 1e-3),
    ("barricade", "constrained", 1e-3),
    ("paper-2", "naive", 1e-3),
    ("ring", "naive", 1e-4),
    ("alley", "constrained", 1e-2),
    ("gauntlet", "naive", 1e-3),
    ("paper-2", "leader", 1e-1),
    ("wall", "constrained", 1e-2),
)


def distributions(quick: bool) -> Rows:
    """Exact distributions to 1e-3: exact commands, the default lattice, and a coarse one.

    Times are medians of three where a computation takes less than five seconds; `ratio` is that
    of states without and with a lattice.
    """
    rows: Rows = []
    for name in SCENARIOS[: 2 if quick else None]:
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for policy in PAPER_POLICIES:
            without = 0
            for kind, spacing in lattices(scenario).items():
                options: dict[str, Any] = {"guide": guide, "aggregation_tol": spacing}
                evaluate = partial(csw.evaluate, scenario, policy, **options)
                evaluate(0.1)
                distribution, wall, cpu = timed(partial(evaluate, TOLERANCE))
                if wall < 5.0 and not quick:
                    distribution, wall, cpu = timed(partial(evaluate, TOLERANCE), 3)
                without = without or distribution.states
                low, high = distribution.success
                rows.append(
                    {
                        "scenario": name,
                        "policy": policy,
                        "lattice": kind,
                        "low": low,
                        "high": high,
                        "width": distribution.residual_mass,
                        "states": distribution.states,
                        "ratio": without / distribution.states,
                        "seconds": wall,
                        "processor": cpu,
                    }
                )
    return rows


def lattices(scenario: csw.Scenario) -> dict[str, float | None]:
    """Spacings by name, as `casswarm.evaluate` takes them."""
    reach = scenario.swarm.v_max * scenario.time.dt
    return {"none": 0.0, "default": None, "coarse": COARSE * reach}


def versus(quick: bool) -> Rows:
    """Time to the same width: exact evaluation and plain Monte Carlo, extrapolated in its runs."""
    number, rows = 10_000 if quick else 100_000, []
    for name, tolerances in (("paper-1", (1e-3, 1e-4)), ("paper-2", (1e-2, 1e-3))):
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for policy in PAPER_POLICIES:
            _, _, plain = timed(
                lambda p=policy, s=scenario, g=guide: csw.simulate(
                    s, [p], number, guide=g, save_trajectories=0
                )
            )
            for tolerance in tolerances:
                distribution, _, cpu = timed(
                    lambda p=policy, s=scenario, g=guide, t=tolerance: csw.evaluate(
                        s, p, t, guide=g
                    )
                )
                width = distribution.success[1] - distribution.success[0]
                p = sum(distribution.success) / 2
                needed = 4 * Z**2 * p * (1 - p) / width**2
                rows.append(
                    {
                        "scenario": name,
                        "policy": policy,
                        "width": width,
                        "exact, processor": cpu,
                        "runs needed": needed,
                        "runs, processor": needed * plain / number,
                        "ratio": needed * plain / number / cpu,
                    }
                )
    return rows


def prediction(quick: bool) -> Rows:
    """Predicted and solved states, and the processor time of a prediction."""
    rows: Rows = []
    for name, policy, tolerance in PREDICTED[: 4 if quick else None]:
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        states = csw.evaluate(scenario, policy, tolerance, guide=guide).states
        made = csw.make_policy(policy, scenario, guide)  # may take a plan
        found = timed(partial(csw.predict_states, scenario, made, tolerance, guide=guide))
        rows.append(
            {
                "scenario": name,
                "policy": policy,
                "tolerance": tolerance,
                "states": states,
                "predicted": found.result.states,
                "ratio": f"{found.result.states / states:.2f}",
                "CPU, s": f"{found.cpu:.2f}",
            }
        )
    return rows

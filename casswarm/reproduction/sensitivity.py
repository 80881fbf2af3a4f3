"""Table II after small changes of the geometry, by the paper's method and with Ipopt."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from ..planning.plan import plan
from ..scenario import Scenario
from ..studies.evaluation import evaluate
from ..studies.simulation import PAPER_POLICIES
from .readings import table_2_of_reading, within
from .success import METHOD, WIDTH, Report

RUNS = 1000
"""Runs per policy and change by the paper's method."""

CALIBRATED = "as calibrated"
"""Name of the geometry without a change."""


def geometry_changes(scenario: Scenario) -> Iterator[tuple[str, dict[str, Any]]]:
    """Small changes of the calibrated geometry: names and values."""
    radars, center = scenario.hazard.radar_positions, np.array(scenario.target.center)
    gate = radars[0] - radars[-1]
    along = gate / np.hypot(*gate)
    for label, shift in (("wider", 0.05), ("narrower", -0.05)):
        moved = radars + np.outer([shift, *[0.0] * (len(radars) - 2), -shift], along)
        yield f"gate 0.1 {label}", {"hazard.radars": moved.tolist()}
    directions = {"right": (1, 0), "left": (-1, 0), "up": (0, 1), "down": (0, -1)}
    for name, direction in directions.items():
        moved = radars + 0.05 * np.array(direction)
        yield f"radars 0.05 {name}", {"hazard.radars": moved.tolist()}
    for label, factor in (("farther", 1.01), ("nearer", 0.99)):
        yield f"target 1 % {label}", {"target.center": (factor * center).tolist()}
    for label, factor in (("wider", 1.1), ("narrower", 0.9)):
        yield f"swarm 10 % {label}", {"swarm.positions": (factor * scenario.positions).tolist()}


def guide_changes(scenario: Scenario) -> Iterator[tuple[str, dict[str, Any]]]:
    """Small changes of what the paper's guide problem does not have: names and values."""
    for margin in (0.05, 0.1, 0.15, 0.3):
        yield f"guide.margin = {margin}", {"guide.margin": margin}
    for factor in (0.8, 1.25):
        a_max = round(factor * scenario.guide_a_max, 6)
        yield f"guide.a_max = {a_max:g}", {"guide.a_max": a_max}


def sensitivity(
    scenario: Scenario, report: Report, seed: int = 0, runs: int = RUNS
) -> pd.DataFrame:
    """Table II after small changes: a row per solver and change.

    Columns: solver (the projected gradient, as in the paper, or ipopt), change, and those of
    `table_2_of_reading`. With the projected gradient: sampled by `runs` runs, with Wilson
    intervals. With Ipopt: midpoints of exact bounds, which are at most 0.01 wide.
    """
    same: list[tuple[str, dict[str, Any]]] = [(CALIBRATED, {})]
    geometries = [*same, *geometry_changes(scenario)]
    rows = []
    for name, change in geometries:
        report(f"{METHOD}: {name}")
        row = table_2_of_reading(scenario.with_values(change), runs=runs, seed=seed)
        rows.append({"solver": METHOD, "change": name, **row})
    for name, change in [*geometries, *guide_changes(scenario)]:
        report(f"ipopt: {name}")
        row = table_2_with_ipopt(scenario.with_values(change))
        rows.append({"solver": "ipopt", "change": name, **row})
    return pd.DataFrame(rows).round(4)


def table_2_with_ipopt(scenario: Scenario) -> dict[str, Any]:
    """Table II along Ipopt's guide, with exact bounds: the columns of `table_2_of_reading`."""
    guide = plan(scenario, certify=False)
    row: dict[str, Any] = {"guide_arrival": guide.arrival, "guide_survival": guide.survival}
    for policy in PAPER_POLICIES:
        success = evaluate(scenario, policy, 10 * WIDTH, guide=guide).success
        row |= {
            policy: sum(success) / 2,
            f"{policy}_low": success.low,
            f"{policy}_high": success.high,
        }
    return row | {"within": within(row)}

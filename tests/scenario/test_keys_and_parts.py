"""The table *Keys and parts* of docs/limits.md: every cell is tried."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from parametric_cases import gradient, steered
from small_scenarios import pair, small

import casswarm as csw
from casswarm.envs import SwarmVectorEnv
from casswarm.errors import ScenarioError

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"
PLAIN = pair(5, swarm__a_max=4.0, swarm__velocity=[1.0, 0.0])
MOVING = [{"position": [1.3, 0.7], "velocity": [0.1, -0.1]}]
ZONE = [{"center": [1.0, -0.6], "radius": 0.2, "rate": 3.0, "edge": 0.3}]
CASES = [{}, {"radars": [[1.3, -0.7], [2.1, 0.9]]}]
VALUES = {
    "hazard.radar": {"hazard.radar": MOVING},
    "hazard.zone": {"hazard.zone": ZONE},
    "hazard.case": {"hazard.case": CASES},
    "success.arrivals": {"success.arrivals": 2},
    "time.substeps": {"time.substeps": 2},
    "target.other": {"target.other": [{"center": [0.2, 1.9], "radius": 0.4}]},
    "swarm.speed": {"swarm.speed": "disc"},
    "information.delay": {"information.delay": 2},
    "swarm.kind": {
        "swarm.kind": ["carrier", "companion"],
        "swarm.kinds.companion": {
            "v_max": 2.5,
            "a_max": 5.0,
            "exposure": 2.0,
            "density": 3.0,
            "counts": False,
        },
    },
}


def run(name: str) -> Callable[[csw.Scenario], float]:
    return lambda one: csw.evaluate(one, name, 1e-6).success.low


def each(*names: str) -> Callable[[csw.Scenario], list[float]]:
    return lambda one: [run(name)(one) for name in names]


PARTS: dict[str, Callable[[csw.Scenario], Any]] = {
    "plan": lambda one: csw.plan(one, certify=False).risk,
    'plan, "projected-gradient"': lambda one: (
        csw.plan(one.replace(guide={"iterations": 50}), "projected-gradient", check=False).rates
    ),
    "plan, ambiguity": lambda one: (
        csw.plan(one.with_values({"hazard.case": CASES}), ambiguity="worst", time_limit=1.0).value
    ),
    "Guide.survival_bound": lambda one: csw.plan(one, time_limit=3.0).survival_bound,
    "ValueFunction": lambda one: csw.ValueFunction.from_scenario(one, 20_000).bounds(0, [0, 0]),
    "success_bound": lambda one: csw.success_bound(one, 20_000, max_work=1e5).value,
    "optimal_value": lambda one: csw.optimal_value(one, 0.05, time_limit=10.0).success,
    "plan_swarm": lambda one: csw.plan_swarm(one).success,
    "naive, leader, constrained": each("naive", "leader", "constrained"),
    "leader-mpc-2, constrained-mpc-2": each("leader-mpc-2", "constrained-mpc-2"),
    "leader-feedback, constrained-feedback": each("leader-feedback", "constrained-feedback"),
    "joint, joint-replanning": each("joint", "joint-replanning"),
    "simulate": lambda one: csw.simulate(one, ["leader"], 20, seed=1).summary.success,
    "evaluate": run("leader"),
    "markov_chain": lambda one: csw.markov_chain(one, "leader", 0.05).success,
    "success_gradient": lambda one: gradient(one, steered(one)).gradient,
    "casswarm.envs": lambda one: SwarmVectorEnv(one, 3).reset(seed=1)[0],
}


def table() -> list[list[str]]:
    """Cells of the table, without marks of code."""
    section = PAGE.read_text("utf-8").split("## Keys and parts")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line[:1] == "|"]
    return [[cell.replace("`", "").strip() for cell in row] for row in rows]


HEAD, _, *ROWS = table()
CELLS = [(row[0], key, cell) for row in ROWS for key, cell in zip(HEAD[1:], row[1:], strict=True)]


def test_table_has_all_keys_and_parts() -> None:
    assert HEAD[1:] == list(VALUES)
    assert [row[0] for row in ROWS] == list(PARTS)


SLOW = "optimal_value", "naive, leader, constrained"  # parts that take seconds


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "key", "cell"),
    [pytest.param(*row, marks=pytest.mark.slow if row[0] in SLOW else ()) for row in CELLS],
)
def test_cell_is_true(part: str, key: str, cell: str) -> None:
    one = PLAIN.with_values(VALUES[key])
    if cell != "refused":
        assert np.isfinite(np.asarray(PARTS[part](one), float)).all()
        return
    with pytest.raises(ScenarioError, match="treats only") as caught:
        PARTS[part](one)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("key", "value"),
    [("success.arrivals", 2), ("swarm.kind", ["carrier"] * 11)],
)
def test_joint_plans_of_many_members_refuse(key: str, value: object) -> None:
    many = small([(0.1 * k, 0.0) for k in range(11)], (2.0, 0.0), [(1.0, 1.0)], 5)
    with pytest.raises(ScenarioError, match="a joint plan of more than 10 members") as caught:
        csw.plan_swarm(many.with_values({key: value}))
    assert caught.value.key == key

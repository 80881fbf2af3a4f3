"""Receding-horizon policies by name: solvers, pickling, errors, success, commands."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from backend_cases import GATE
from commands import casswarm
from small_scenarios import patrolled
from window_cases import GOAL, HAZARD, MOTION, RHO, both, window

import casswarm as csw
from casswarm import make_solver
from casswarm.errors import PolicyError, SolverError
from casswarm.figures import mpc_chart
from casswarm.formation import InteriorPoint, corridor_formation
from casswarm.motion import Step
from casswarm.policies import LeaderPolicy, make_policy

# --- custom rates, solvers, pickling, names


def test_mpc_with_custom_rates_is_solved_by_ipopt() -> None:
    scenario = csw.load_scenario("paper-1").with_values(
        {
            "hazard": {"kind": patrolled, "radars": [[4.4, 4.6]]},
            "swarm.positions": [[0.0, 0.0], [0.3, 0.0]],
        }
    )
    guide = csw.plan(scenario, certify=False)
    policy = make_policy("constrained", scenario, guide, horizon=2)
    X = scenario.positions[None]
    decision = policy.decide(0, X, np.tile(guide.velocities[0], (1, 2, 1)), np.ones((1, 2), bool))
    assert not decision.failures.any()
    assert not decision.fallbacks.any()


def test_unsuitable_solver_raises_solver_error() -> None:
    problem = both(window(2, 3, 2, seed=19))[0]
    with pytest.raises(SolverError, match=r"spectral cannot take mpc-formation\["):
        make_solver("spectral").solve_batch(problem.nlp, problem.instances)
    step = window(2, 3, 1, seed=19)
    data = Step(HAZARD, MOTION, step.positions, step.previous_velocities, step.alive, GOAL[None])
    formation = corridor_formation(data, RHO)
    with pytest.raises(SolverError, match="needs paths within limits"):
        InteriorPoint().solve_batch(formation.nlp, formation.instances)


def test_mpc_policy_pickles() -> None:
    scenario = csw.load_scenario("paper-1")
    guide = csw.plan(scenario, certify=False)
    policy = make_policy("leader-mpc-3", scenario, guide)
    assert policy.name == "leader-mpc-3"
    X = scenario.positions[None]
    state = (0, X, np.tile(guide.velocities[0], (1, 5, 1)), np.ones((1, 5), bool))
    again = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(again.velocities(*state), policy.velocities(*state))


@pytest.mark.parametrize(
    ("name", "horizon", "words"),
    [
        ("leader", 0, "horizon = 0; allowed: whole numbers from 1"),
        ("leader", 2.5, "horizon = 2.5"),
        ("naive", 3, "'naive' has no horizon"),
        ("leader-mpc-0", 1, "horizon = 0"),
        ("leader-mpc-3", 2, "includes its horizon"),
        ("leader-mpc-H", 1, "'leader-mpc-H' is unknown; .*leader-mpc-3"),
        ("leader-mpc-", 1, "unknown"),
        ("naive-mpc-3", 1, "unknown"),
    ],
)
def test_invalid_horizon_raises_policy_error(name: str, horizon: int, words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        make_policy(name, csw.load_scenario("paper-1"), horizon=horizon)


# --- effect of the horizon


def test_horizon_avoids_most_infeasible_corridor_steps() -> None:
    scenario = csw.load_scenario("paper-1").with_values(GATE)
    guide = csw.plan(scenario, certify=False)
    study = csw.simulate(scenario, ["constrained", "constrained-mpc-5"], 40, guide=guide)
    near, far = study.summary["infeasible"]
    assert far < 0.4 * near
    assert not study.summary["solver_failures"].any()


def test_leader_with_horizon_keeps_leader_selection() -> None:
    scenario = csw.load_scenario("paper-1")
    policy = make_policy("leader", scenario, leader_selection="first", horizon=2)
    assert isinstance(policy, LeaderPolicy)
    assert policy.leader_selection == "first"


@pytest.mark.slow
def test_commands_accept_several_horizons(tmp_path: Path) -> None:
    names = ["leader", "leader-mpc-2", "constrained-mpc-3"]
    policies = [word for name in names for word in ("--policy", name)]
    output = casswarm(tmp_path, "simulate", "paper-1", *policies, "--runs", 20, "--quiet").stdout
    assert all(f"\n{name} " in output for name in names)
    output = casswarm(
        tmp_path,
        "evaluate",
        "paper-1",
        *policies[2:],
        "--tolerance",
        0.2,
        "--aggregation-tol",
        1e-6,
    ).stdout
    assert "leader-mpc-2 " in output
    assert "constrained-mpc-3 " in output
    words = ("simulate", "paper-1", "--policy", "leader-mpc-x", "--runs", 5)
    assert "leader-mpc-3" in casswarm(tmp_path, *words, code=2).stderr


def test_mpc_chart_shows_success_and_infeasible_per_scenario() -> None:
    table = pd.DataFrame(
        {
            "scenario": ["a", "a", "b", "b"],
            "policy": ["leader"] * 4,
            "horizon": [1, 3, 1, 3],
            "success": [0.2, 0.5, 0.1, 0.4],
            "success_low": [0.1, 0.4, 0.1, 0.3],
            "success_high": [0.3, 0.6, 0.1, 0.5],
            "infeasible": [8.0, 1.0, 4.0, 0.0],
        }
    )
    axes = mpc_chart(table).axes
    assert [panel.get_title() for panel in axes] == ["a", "b", "", ""]
    np.testing.assert_array_equal(axes[2].lines[0].get_xydata(), [[1, 8], [3, 1]])
    np.testing.assert_array_equal(axes[1].lines[0].get_xydata(), [[1, 0.1], [3, 0.4]])

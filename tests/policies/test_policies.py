"""Policies by name: decisions, states, leader selection, solver failures, errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from commands import casswarm
from failing_solver import Failing
from policy_cases import MEMBERS, guide, policy, scenario, states
from small_scenarios import DT, Array

from casswarm import Decision, Status, evaluate, make_policy, simulate
from casswarm.guide import initial_velocities
from casswarm.nlp import Instances, Nlp
from casswarm.policies import member_guides
from casswarm.solvers import Ipopt


def decided(name: str, state: tuple[Array, ...], step: int = 2, **options: Any) -> Decision:
    return policy(name, **options).decide(step, *state)


# --- goals after arrival


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_goal_after_guide_arrival_is_target_centre(name: str) -> None:
    rng = np.random.default_rng(4)
    center = np.array([4.0, 1.5])
    positions = center + rng.normal(0, 0.1, (5, 4, 2))
    state = (positions, np.zeros_like(positions), np.ones((5, 4), bool))
    velocities = decided(name, state, step=guide().arrival).velocities
    distances = np.linalg.norm(positions + DT * velocities - center, axis=-1)
    if name == "leader":
        assert (distances.min(axis=1) < 1e-9).all()
    else:
        assert distances.max() <= np.sqrt(0.05) + 1e-9


# --- naive


def test_member_guides_start_at_members_states() -> None:
    guides = member_guides(scenario(), guide())
    assert [tuple(g.positions[0]) for g in guides] == MEMBERS
    before = guide().velocities[0]
    for g in guides:
        assert ((g.velocities[0] - before) ** 2).sum() <= 0.5 + 1e-6
        assert g.arrives


def test_naive_members_follow_own_guides() -> None:
    guides = policy("naive").guides
    positions = np.array([[g.positions[2] for g in guides]] * 3)
    previous_velocities = np.array([[g.velocities[1] for g in guides]] * 3)
    alive = np.array([[True] * 4, [True, False, False, True], [False, False, True, False]])
    decision = decided("naive", (positions, previous_velocities, alive))
    expected = np.array([g.velocities[2] for g in guides])
    for b in range(3):
        np.testing.assert_allclose(decision.velocities[b][alive[b]], expected[alive[b]], atol=1e-9)
    assert decision.infeasible.tolist() == [0, 0, 0]


def test_naive_member_off_its_guide_counts_infeasible_while_alive() -> None:
    guides = policy("naive").guides
    positions = np.array([[g.positions[2] for g in guides]] * 2)
    previous_velocities = np.array([[g.velocities[1] for g in guides]] * 2)
    positions[:, 1] += 3.0
    alive = np.array([[True] * 4, [True, False, True, True]])
    assert decided("naive", (positions, previous_velocities, alive)).infeasible.tolist() == [1, 0]


def test_initial_velocities_are_guides_first_or_scenarios() -> None:
    np.testing.assert_array_equal(
        initial_velocities(scenario(), guide()), np.tile(guide().velocities[0], (4, 1))
    )
    given = scenario().with_values({"swarm.velocity": [0.5, -0.25]})
    assert initial_velocities(given, guide()).tolist() == [[0.5, -0.25]] * 4


# --- leader


def test_leader_stays_on_guide_while_alive() -> None:
    study = simulate(scenario(), ["leader"], runs=60, seed=1, guide=guide(), save_trajectories=60)
    led = 0
    for trace in study.trajectories["leader"]:
        steps = np.flatnonzero(trace.alive[:, 0])[1:]  # member 0 starts on the guide
        expected = np.array([guide().reference(step) for step in steps]).reshape(-1, 2)
        np.testing.assert_allclose(trace.positions[steps, 0], expected, atol=1e-9)
        led += len(steps)
    assert led > 100
    assert {trace.alive[-1, 0] for trace in study.trajectories["leader"]} == {True, False}


def test_nearest_survivor_leads_after_loss_of_leader() -> None:
    position = guide().positions[2]
    offsets = np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.1], [0.0, 0.15]])
    positions = (position + offsets)[None]
    previous_velocities = np.tile(guide().velocities[2], (1, 4, 1))
    goal = guide().positions[3]
    for alive, leader in [([1] * 4, 0), ([0, 1, 1, 1], 2), ([0, 1, 0, 1], 3), ([0, 1, 0, 0], 1)]:
        state = (positions, previous_velocities, np.array([alive], bool))
        following = positions[0] + DT * decided("leader", state).velocities[0]
        distances = np.where(alive, np.hypot(*(following - goal).T), np.inf)
        assert distances[leader] < 1e-9


# --- constrained


def test_constrained_members_stay_in_corridor_if_feasible() -> None:
    positions, previous_velocities, alive = states("constrained", 30, seed=6)
    decision = decided("constrained", (positions, previous_velocities, alive))
    following = positions + DT * decision.velocities
    away = np.linalg.norm(following - guide().positions[3], axis=-1) > np.sqrt(0.05) + 1e-8
    assert ((away & alive).sum(axis=1) == decision.infeasible).all()
    assert 0 < decision.infeasible.sum() < alive.sum() / 2


# --- optimal


def test_pair_off_plan_succeeds_more_often_than_straight_lines():
    """From a disturbed start, members return to the plan."""
    moved = scenario("optimal").with_values({"swarm.positions": [[0.1, -0.3], [-0.2, 0.1]]})
    found = evaluate(moved, policy("optimal"), 0.0, guide=guide("optimal")).success
    naive = evaluate(moved, "naive", 0.0).success
    assert found.low > naive.high


@pytest.mark.slow
def test_optimal_is_at_least_as_good_as_every_other_policy():
    laws = {
        name: evaluate(scenario("optimal"), name, 1e-6, guide=guide("optimal")).success
        for name in ("naive", "leader", "leader-feedback", "joint", "joint-replanning")
    }
    best = evaluate(scenario("optimal"), policy("optimal"), 0.0, guide=guide("optimal")).success
    assert best.low >= max(law.low for law in laws.values()) - 1e-9
    assert best.width < 1e-9


@pytest.mark.slow
def test_command_line_refuses_five_members(tmp_path):
    done = casswarm(tmp_path, "evaluate", "gauntlet", "--policy", "optimal", code=2)
    assert "two members" in done.stderr
    assert "Traceback" not in done.stderr


# --- solver failures


def every_second(_nlp: Nlp, instances: Instances) -> list[bool]:
    return [i % 2 == 1 for i in range(len(instances))]


@pytest.mark.parametrize(
    ("x", "status"),
    [(np.nan, Status.SOLVED), (9.0, Status.SOLVED), (1.0, Status.ITERATION_LIMIT)],
)
@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_solver_failure_is_counted_and_fallback_is_feasible(
    name: str, x: float, status: Status
) -> None:
    positions, previous_velocities, _ = states("leader", 6, seed=7)
    alive = np.ones((6, 4), bool)
    state = (np.where(positions == 0, guide().positions[2], positions), previous_velocities, alive)
    decision = decided(name, state, solver=Failing(every_second, x, status))
    assert decision.failures.tolist() == [0, 1] * 3
    assert np.abs(decision.velocities).max() <= 2.0
    assert (
        np.linalg.norm(decision.velocities - previous_velocities, axis=-1).max()
        <= np.sqrt(0.5) + 1e-9
    )
    assert (decision.infeasible == decided(name, state).infeasible).all()
    if name == "leader" and np.isnan(x):  # protectors keep their velocity, the leader leads
        kept = (decision.velocities == previous_velocities).all(axis=2).sum(axis=1)
        assert kept[1::2].tolist() == [3] * 3


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_fixed_iterations_are_no_failure(name: str) -> None:
    """The paper's method ends after its iterations; an optimiser that does so has failed."""
    state = states("leader", 6, seed=7)
    paper = decided(name, state, solver="projected-gradient")
    assert paper.failures.tolist() == [0] * 6
    assert decided(name, state, solver=Ipopt(max_iter=1)).failures.sum() > 0


@pytest.mark.slow
def test_naive_guides_are_planned_by_the_method_of_the_guide() -> None:
    by_ipopt = make_policy("naive", scenario(), guide())
    by_paper = make_policy("naive", scenario(), solver="projected-gradient")
    for policy_, solver in ((by_ipopt, "ipopt"), (by_paper, "projected-gradient")):
        assert {own.solution.solver for own in policy_.guides} == {solver}  # type: ignore[attr-defined]


def test_solver_failures_appear_in_tables() -> None:
    broken = Failing(every_second, np.nan, Status.FAILED)
    study = simulate(scenario(), ["constrained"], runs=20, guide=guide(), solver=broken)
    assert study.summary["solver_failures"][0] == study.runs["solver_failures"].sum() > 0


# --- solvers


def test_solver_options_reach_the_solver() -> None:
    made = make_policy("leader", scenario(), guide(), "ipopt", solver_options={"max_iter": 7})
    assert made.solver.max_iter == 7  # type: ignore[attr-defined]


def test_make_policy_takes_name_and_scenario_in_either_order() -> None:
    one = make_policy("leader", scenario(), guide(), horizon=2)
    other = make_policy(scenario(), "leader", guide(), horizon=2)
    assert one.name == other.name == "leader-mpc-2"
    assert (one.guide, one.motion, one.hazard) == (other.guide, other.motion, other.hazard)

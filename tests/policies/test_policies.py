"""Policies by name: decisions, states, leader selection, solver failures, errors."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenarios import DT, Array, small

import casswarm as csw
from casswarm import (
    Decision,
    Guide,
    Policy,
    PolicyError,
    Scenario,
    SolverError,
    Status,
    make_policy,
    plan,
    simulate,
)
from casswarm.guide import initial_velocities
from casswarm.nlp import Instances, Nlp
from casswarm.policies import POLICIES, member_guides
from casswarm.solvers import Answer, Ipopt, Solver

Flags = NDArray[np.bool_]
POSITIONS = [(0.0, 0.0), (0.4, -0.3), (-0.3, 0.35), (0.1, 0.6)]


@cache
def scenario() -> Scenario:
    """Four members and a radar near the straight line; the guide turns around it."""
    return small(POSITIONS, (4.0, 1.5), [(2.0, 0.2)], 14, guide__search="local", guide__a_max=0.3)


ANY_SIZE = [name for name in POLICIES if name != "optimal"]  # which is for two members


@cache
def guide() -> Guide:
    return plan(scenario())


def states(batch: int, seed: int, step: int = 2) -> tuple[Array, Array, Flags]:
    """States around the guide at a step, with zero entries of the destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, 4)) < 0.7
    alive[:, 0] |= ~alive.any(axis=1)
    positions = guide().positions[step] + rng.normal(0, 0.15, (batch, 4, 2))
    previous_velocities = guide().velocities[step - 1] + rng.normal(0, 0.2, (batch, 4, 2))
    living = alive[..., None]
    return positions * living, np.clip(previous_velocities, -2, 2) * living, alive


@cache
def policy(name: str, **options: Any) -> Policy:
    return make_policy(name, scenario(), guide(), **options)


def decided(name: str, state: tuple[Array, ...], step: int = 2, **options: Any) -> Decision:
    return policy(name, **options).decide(step, *state)


# --- every policy


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "joint-replanning" else ())
        for name in ANY_SIZE
    ],
)
def test_decision_respects_hard_constraints(name: str) -> None:
    positions, previous_velocities, alive = states(40, seed=0)
    velocities = decided(name, (positions, previous_velocities, alive)).velocities
    assert velocities.shape == positions.shape
    assert np.abs(velocities[alive]).max() <= 2.0
    changes = np.hypot(*(velocities - previous_velocities)[alive].T)
    assert changes.max() <= np.sqrt(0.5) + 1e-9
    assert (velocities[~alive] == 0).all()


@pytest.mark.parametrize("name", ANY_SIZE)
def test_decision_of_batch_equals_single_states(name: str) -> None:
    state = states(9, seed=1)
    together = decided(name, state)
    for b in range(9):
        alone = decided(name, tuple(part[b : b + 1] for part in state))
        np.testing.assert_allclose(together.velocities[b], alone.velocities[0], atol=1e-9)
        assert together.infeasible[b] == alone.infeasible[0]
        assert together.failures[b] == alone.failures[0] == 0


@pytest.mark.parametrize("name", ANY_SIZE)
def test_velocities_equal_those_of_decision(name: str) -> None:
    state = states(5, seed=2)
    found = policy(name).velocities(3, *state)
    np.testing.assert_array_equal(found, decided(name, state, step=3).velocities)
    assert policy(name).name == name


@pytest.mark.parametrize("name", ANY_SIZE)
def test_single_state_equals_batch_of_one(name: str) -> None:
    state = tuple(part[0] for part in states(1, seed=5))
    batch = decided(name, tuple(part[None] for part in state))
    assert policy(name).velocities(2, *state).shape == (4, 2)
    np.testing.assert_array_equal(policy(name).velocities(2, *state), batch.velocities[0])
    np.testing.assert_array_equal(decided(name, state).velocities, batch.velocities)


def test_state_of_wrong_shape_raises_policy_error_with_shapes() -> None:
    positions, previous_velocities, alive = states(3, seed=5)
    with pytest.raises(PolicyError, match=r"expected \(n, 2\), \(n, 2\), \(n,\)") as caught:
        policy("naive").decide(4, positions, previous_velocities, alive[0])
    assert (caught.value.policy, caught.value.step) == ("naive", 4)
    assert caught.value.shapes == [(3, 4, 2), (3, 4, 2), (4,)]


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
    assert [tuple(g.positions[0]) for g in guides] == POSITIONS
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
    positions, previous_velocities, alive = states(30, seed=6)
    decision = decided("constrained", (positions, previous_velocities, alive))
    following = positions + DT * decision.velocities
    away = np.linalg.norm(following - guide().positions[3], axis=-1) > np.sqrt(0.05) + 1e-8
    assert ((away & alive).sum(axis=1) == decision.infeasible).all()
    assert 0 < decision.infeasible.sum() < alive.sum() / 2


# --- solver failures


class Broken(Solver):
    """Fails in every second state: with NaN, with an infeasible point, or by its status."""

    name = "broken"

    def __init__(self, x: float, status: Status) -> None:
        self.x, self.status = x, status

    def prepare(self, nlp: Nlp) -> None:
        pass

    def run(self, nlp: Nlp, instances: Instances) -> list[Answer]:
        start = instances.x0
        return [
            Answer(np.full_like(start[i], self.x), self.status, "broken", 0, 0, 0.0)
            if i % 2
            else answer
            for i, answer in enumerate(Ipopt().timed_answers(nlp, instances)[1])
        ]


@pytest.mark.parametrize(
    ("x", "status"),
    [(np.nan, Status.SOLVED), (9.0, Status.SOLVED), (1.0, Status.ITERATION_LIMIT)],
)
@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_solver_failure_is_counted_and_fallback_is_feasible(
    name: str, x: float, status: Status
) -> None:
    positions, previous_velocities, _ = states(6, seed=7)
    alive = np.ones((6, 4), bool)
    state = (np.where(positions == 0, guide().positions[2], positions), previous_velocities, alive)
    decision = decided(name, state, solver=Broken(x, status))
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
    state = states(6, seed=7)
    paper = decided(name, state, solver="projected-gradient")
    assert paper.failures.tolist() == [0] * 6
    assert decided(name, state, solver=Ipopt(max_iter=1)).failures.sum() > 0


def test_naive_guides_are_planned_by_the_method_of_the_guide() -> None:
    by_ipopt = make_policy("naive", scenario(), guide())
    by_paper = make_policy("naive", scenario(), solver="projected-gradient")
    for policy_, solver in ((by_ipopt, "ipopt"), (by_paper, "projected-gradient")):
        assert {own.solution.solver for own in policy_.guides} == {solver}  # type: ignore[attr-defined]


def test_solver_failures_appear_in_tables() -> None:
    study = simulate(
        scenario(), ["constrained"], runs=20, guide=guide(), solver=Broken(np.nan, Status.FAILED)
    )
    assert study.summary["solver_failures"][0] == study.runs["solver_failures"].sum() > 0


# --- names


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("leeder", {}, "policy 'leeder' is unknown; did you mean 'leader'"),
        ("xyz", {}, "policy 'xyz' is unknown .known: naive, constrained, leader"),
        ("leader", {"leader_selection": "neerest"}, "did you mean 'nearest'"),
    ],
)
def test_unknown_policy_name_suggests_nearest(
    name: str, options: dict[str, str], message: str
) -> None:
    with pytest.raises(PolicyError, match=message):
        make_policy(name, scenario(), guide(), **options)


def test_solver_options_reach_the_solver() -> None:
    made = make_policy("leader", scenario(), guide(), "ipopt", solver_options={"max_iter": 7})
    assert made.solver.max_iter == 7  # type: ignore[attr-defined]


def test_unknown_solver_of_policy_raises_solver_error() -> None:
    with pytest.raises(SolverError, match="did you mean 'ipopt'"):
        make_policy("leader", scenario(), guide(), solver="ipop")


# --- empty batches, and numbers of the destroyed and the living


SCENARIO = small(
    [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.3)], (3.0, 0.5), [(1.5, 1.3)], 8, guide__a_max=0.3
)
NAMES = ("naive", "leader", "constrained", "leader-mpc-2", "leader-feedback")
SOLVERS = ("auto", "ipopt")


def made(name: str, solver: str) -> csw.Policy:
    guide = csw.plan(SCENARIO, certify=False)
    return csw.make_policy(name, SCENARIO, guide, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", NAMES)
def test_empty_batch_has_empty_decision(name: str, solver: str) -> None:
    none = np.zeros((0, 3, 2))
    decision = made(name, solver).decide(0, none, none, np.zeros((0, 3), bool))
    assert decision.velocities.shape == (0, 3, 2)
    assert decision.failures.shape == decision.infeasible.shape == (0,)


@pytest.mark.parametrize("missing", [(np.nan, np.nan), (np.inf, -np.inf)])
@pytest.mark.parametrize("name", NAMES)
def test_entries_of_destroyed_members_may_be_missing(
    name: str, missing: tuple[float, float]
) -> None:
    policy, alive = made(name, "auto"), np.array([[True, False, True], [True, True, True]])
    positions, velocities = np.stack([SCENARIO.positions] * 2), np.zeros((2, 3, 2))
    positions[0, 1] = 0.0
    expected = policy.velocities(0, positions, velocities, alive)
    positions[0, 1] = velocities[0, 1] = missing
    np.testing.assert_array_equal(policy.velocities(0, positions, velocities, alive), expected)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_living_members_have_finite_states(value: float) -> None:
    positions = SCENARIO.positions.copy()
    positions[1, 0] = value
    for state in ((positions, np.zeros((3, 2))), (SCENARIO.positions, positions)):
        with pytest.raises(csw.PolicyError, match="living members are not finite at step 4"):
            made("leader", "auto").decide(4, *state, np.ones(3, bool))

"""Receding-horizon policies: one-step equivalence, limits, invariances, names, success."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from small_scenarios import Array
from window_cases import DT, GOAL, MOTION, RHO, both, leaders_of, window

import casswarm as csw
from casswarm import make_solver
from casswarm.formation import (
    Formation,
    InteriorPoint,
    corridor_formation,
    corridor_mpc_formation,
    leader_formation,
)
from casswarm.formation.horizon import MARGIN
from casswarm.motion import Step
from casswarm.policies import applied_decision, make_policy


def paths_of(problem: Formation, data: Step) -> Array:
    """Displacements (B, H, n, 2) by the batch solver, all converged; prescribed ones unchanged."""
    batch, n = data.alive.shape
    rows = np.flatnonzero(problem.free.any(axis=1))
    found = problem.instances.x0.copy()
    run = InteriorPoint().run_batch(problem.nlp, problem.instances[rows])
    assert run.results.verified[:, 2].max(initial=0.0) <= 1e-6
    found[rows] = run.results.x
    return found.reshape(batch, data.horizon, n, 2)


def velocities_of(advances: Array) -> Array:
    return np.diff(advances, axis=1, prepend=np.zeros_like(advances[:, :1]))


# --- a horizon of one step


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_horizon_of_one_step_equals_one_step_policy(name: str) -> None:
    scenario = csw.load_scenario("paper-1")
    guide = csw.plan(scenario, certify=False)
    paper = make_policy(name, scenario, guide)
    assert type(make_policy(name, scenario, guide, horizon=1)) is type(paper)
    assert type(make_policy(f"{name}-mpc-1", scenario, guide)) is type(paper)
    mpc = replace(make_policy(name, scenario, guide, horizon=4), horizon=1)  # type: ignore[type-var]
    last = make_policy(name, scenario, guide, horizon=4)
    rng = np.random.default_rng(1)
    for step, policies in ((0, [mpc]), (9, [mpc]), (guide.arrival - 1, [mpc, last])):
        alive = rng.random((6, 5)) > 0.3
        alive[:, 0] = True
        X = (guide.reference(step) + rng.normal(0, 0.2, (6, 5, 2))) * alive[..., None]
        before = rng.uniform(-1.5, 1.5, (6, 5, 2)) * alive[..., None]
        expected = paper.decide(step, X, before, alive)
        for policy in policies:
            found = policy.decide(step, X, before, alive)
            np.testing.assert_array_equal(found.velocities, expected.velocities)
            np.testing.assert_array_equal(found.infeasible, expected.infeasible)


def test_mpc_formation_of_one_step_matches_spg_solution() -> None:
    data = window(40, 4, 1, seed=2)
    leaders = leaders_of(data)
    pairs = ((leader_formation(data, leaders), 0.0), (corridor_formation(data, RHO), MARGIN))
    for mpc, (one, margin) in zip(both(data), pairs, strict=True):
        found, paper = (
            applied_decision(data, mpc, InteriorPoint()),
            one.instances.lbx.reshape(40, 4, 2).copy(),
        )
        rows = np.flatnonzero(one.free.any(axis=1))
        solution = make_solver("spectral").solve_batch(one.nlp, one.instances[rows])
        assert solution.success.all()
        paper[rows] = solution.x.reshape(-1, 4, 2)
        assert not found.failures.any()
        np.testing.assert_array_equal(found.infeasible, one.infeasible.sum(axis=1))
        # members outside the corridor have the slack of the margin, which moves the others slightly
        calm = ~one.infeasible.any(axis=1, keepdims=True) | (margin == 0.0)
        met = data.alive & calm
        np.testing.assert_allclose(found.velocities[met], paper[met], atol=2e-4)
        reached = data.positions + DT * found.velocities, data.positions + DT * paper
        far, near = (np.hypot(*(position - GOAL).transpose(2, 0, 1)) for position in reached)
        lost = data.alive & one.infeasible
        assert (far[lost] <= near[lost] + margin * math.sqrt(RHO) + 1e-6).all()


# --- limits and counts


@pytest.mark.parametrize("steps", [2, 4])
def test_limits_hold_along_path_and_in_applied_velocities(steps: int) -> None:
    data = window(30, 4, steps, seed=11, spread=0.6)
    for problem in both(data):
        v = velocities_of(paths_of(problem, data))[problem.free.any(axis=1)]
        assert np.abs(v).max() <= MOTION.v_max + 1e-9
        before = np.concatenate(
            [data.previous_velocities[problem.free.any(axis=1)][:, None], v], axis=1
        )
        turns = (np.diff(before, axis=1) ** 2).sum(axis=-1)
        assert turns.max() <= MOTION.a_max + 1e-9
        decision = applied_decision(data, problem, make_solver("auto"))
        assert not decision.failures.any()
        first = decision.velocities
        assert np.abs(first).max() <= MOTION.v_max + 1e-9
        turns = ((first - data.previous_velocities) ** 2).sum(axis=-1)
        assert turns[data.alive].max() <= MOTION.a_max + 1e-9
        assert (first[~data.alive] == 0).all()


def test_sets_of_paths_contain_what_is_within_their_limits() -> None:
    data = window(20, 4, 3, seed=5)
    for problem in both(data):
        sets, free = problem.instances.feasible_set, problem.free
        assert sets is not None
        paths = paths_of(problem, data)
        assert sets.contains(paths, 1e-7)[free].all()
        far = paths + np.array([2.1 * MOTION.v_max, 0.0]) * np.arange(1, 4)[:, None, None]
        assert not sets.contains(far, 1e-7)[free].any()
        shifted = paths + np.array([0.0, 10.0])
        assert not sets[:5].contains(shifted[:5], 1e-7)[free[:5]].any()


def test_infeasible_counts_members_that_miss_next_soft_constraint() -> None:
    data = window(40, 4, 3, seed=12)
    led, kept = both(data)
    for problem, constrained, radius in (
        (led, np.arange(4) == leaders_of(data)[:, None], 0.0),
        (kept, data.alive, math.sqrt(RHO)),
    ):
        decision = applied_decision(data, problem, make_solver("auto"))
        away = data.positions + DT * decision.velocities - data.goals[0]
        missed = np.hypot(away[..., 0], away[..., 1]) > radius + 1e-6 * MOTION.v_max * DT
        np.testing.assert_array_equal(decision.infeasible, (missed & constrained).sum(axis=1))
        assert 0 < decision.infeasible.sum() < constrained.sum()


def test_mpc_of_single_member_is_feasible() -> None:
    data = window(5, 1, 3, seed=17, deaths=0.0)
    for problem in both(data):
        velocities = applied_decision(data, problem, make_solver("auto")).velocities
        assert np.isfinite(velocities).all()
        assert np.abs(velocities).max() <= MOTION.v_max


def test_corridor_once_feasible_stays_feasible_in_next_horizon() -> None:
    """Members that have met every corridor continue to do so in closed loop."""
    data = window(20, 3, 4, seed=18, spread=0.05, deaths=0.0)
    met = np.ones(20, bool)
    pace = 1.4 * np.stack([np.cos(0.25 * np.arange(12)), np.sin(0.25 * np.arange(12))], axis=1)
    path = GOAL + DT * np.concatenate([np.zeros((1, 2)), np.cumsum(pace[1:], axis=0)])
    short = []
    for t in range(8):
        now = replace(data, goals=path[t : t + 4])
        decision = applied_decision(now, corridor_mpc_formation(now, RHO), make_solver("auto"))
        X = data.positions + DT * decision.velocities
        data = replace(data, positions=X, previous_velocities=decision.velocities)
        short.append(decision.infeasible)
        met &= decision.infeasible == 0
    assert met.sum() >= 10
    assert sum(short[4:]).sum() == 0

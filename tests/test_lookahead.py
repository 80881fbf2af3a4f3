"""Look-ahead formation: the paper's method at one step, known answers, Ipopt, laws and limits."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from commands import casswarm
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from small_scenarios import Array, rate_by_hand

import casswarm as cs
from casswarm import Saturation, SaturationCollision, make_solver
from casswarm.errors import PolicyError, SolverError
from casswarm.figures import look_ahead_chart
from casswarm.policies import LeaderAheadPolicy, LeaderPolicy, make_policy
from casswarm.policies.lookahead import flown
from casswarm.problems.formation import (
    Motion,
    Step,
    corridor_formation,
    formation_nlp,
    leader_formation,
)
from casswarm.problems.lookahead import (
    MARGIN,
    LookAhead,
    Window,
    corridor_ahead,
    leader_ahead,
    lookahead_nlp,
)
from casswarm.residuals import judge
from casswarm.solvers.barrier import Barrier

RADARS = ((3.0, 2.0), (1.0, 3.0))
HAZARD, COLLIDING = Saturation(RADARS), SaturationCollision(RADARS)
DT, RHO = 0.33, 0.05
MOTION = Motion(v_max=2.0, a_max=0.5, dt=DT)
GOAL = np.array([1.0, 1.0])


def window(
    batch: int, n: int, steps: int, seed: int, spread: float = 0.3, deaths: float = 0.3
) -> Window:
    """States of members on their way along a bent guide, some of them destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, n)) >= deaths
    alive[:, 0] |= ~alive.any(axis=1)
    previous = np.clip(rng.normal([1.2, 0.8], 0.6, (batch, n, 2)), -1.9, 1.9)
    positions = GOAL - DT * previous + rng.normal(0, spread, (batch, n, 2))
    turn = 0.25 * np.arange(steps)
    pace = 1.4 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    goals = GOAL + DT * np.concatenate([np.zeros((1, 2)), np.cumsum(pace[1:], axis=0)])
    living = alive[..., None]
    return Window(HAZARD, MOTION, positions * living, previous * living, alive, goals)


def leaders_of(data: Window) -> NDArray[np.intp]:
    return np.asarray(data.alive.argmax(axis=1))


def both(data: Window) -> list[LookAhead]:
    return [leader_ahead(data, leaders_of(data)), corridor_ahead(data, RHO)]


def paths_of(problem: LookAhead, data: Window) -> Array:
    """Advances (B, H, n, 2) by the batch solver, every one converged; those given as they are."""
    batch, n = data.alive.shape
    rows = np.flatnonzero(problem.free.any(axis=1))
    found = problem.instances.start.copy()
    run = Barrier().run(problem.nlp, problem.instances[rows])
    assert run.judged[:, 2].max(initial=0.0) <= 1e-6
    found[rows] = run.x
    return found.reshape(batch, data.steps, n, 2)


def velocities_of(advances: Array) -> Array:
    return np.diff(advances, axis=1, prepend=np.zeros_like(advances[:, :1]))


# --- one step: the paper's method


def test_program_of_one_step_is_the_formation_program_with_every_number_the_same() -> None:
    rng = np.random.default_rng(0)
    step = Step(HAZARD, MOTION, *_state(rng), np.ones((1, 4), bool), GOAL)
    for corridor in (False, True):
        one, ahead = formation_nlp(HAZARD, 4, corridor), lookahead_nlp(HAZARD, 4, 1, corridor)
        assert one.sizes == ahead.sizes
        p = corridor_formation(step, RHO).instances.parameters[0]
        for _ in range(5):
            v = rng.normal(size=8)
            for a, b in zip(one.evaluate(v, p), ahead.evaluate(v, p), strict=True):
                np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


def _state(rng: np.random.Generator) -> tuple[Array, Array]:
    return rng.normal(size=(1, 4, 2)), rng.normal(size=(1, 4, 2))


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_a_look_ahead_of_one_step_gives_the_one_step_policy_bit_for_bit(name: str) -> None:
    scenario = cs.load_scenario("paper-1")
    guide = cs.plan(scenario, certify=False)
    paper = make_policy(name, scenario, guide)
    assert type(make_policy(name, scenario, guide, look_ahead=1)) is type(paper)
    assert type(make_policy(f"{name}-ahead-1", scenario, guide)) is type(paper)
    ahead = replace(make_policy(name, scenario, guide, look_ahead=4), look_ahead=1)  # type: ignore[type-var]
    last = make_policy(name, scenario, guide, look_ahead=4)
    rng = np.random.default_rng(1)
    for step, policies in ((0, [ahead]), (9, [ahead]), (guide.arrival - 1, [ahead, last])):
        alive = rng.random((6, 5)) > 0.3
        alive[:, 0] = True
        X = (guide.reference(step) + rng.normal(0, 0.2, (6, 5, 2))) * alive[..., None]
        before = rng.uniform(-1.5, 1.5, (6, 5, 2)) * alive[..., None]
        expected = paper.decide(step, X, before, alive)
        for policy in policies:
            found = policy.decide(step, X, before, alive)
            np.testing.assert_array_equal(found.velocities, expected.velocities)
            np.testing.assert_array_equal(found.shortfalls, expected.shortfalls)


def test_window_of_one_step_has_the_one_step_answer_by_the_other_solver() -> None:
    data = window(40, 4, 1, seed=2)
    step = Step(HAZARD, MOTION, data.positions, data.previous, data.alive, data.goals[0])
    leaders = leaders_of(data)
    pairs = ((leader_formation(step, leaders), 0.0), (corridor_formation(step, RHO), MARGIN))
    for ahead, (one, margin) in zip(both(data), pairs, strict=True):
        found, paper = flown(data, ahead, Barrier()), one.instances.lower.reshape(40, 4, 2).copy()
        rows = np.flatnonzero(one.free.any(axis=1))
        solution = make_solver("spectral").solve_batch(one.nlp, one.instances[rows])
        assert solution.success.all()
        paper[rows] = solution.x.reshape(-1, 4, 2)
        assert not found.failures.any()
        np.testing.assert_array_equal(found.shortfalls, one.shortfalls.sum(axis=1))
        # who misses the corridor has the margin's room, which moves the others a little
        calm = ~one.shortfalls.any(axis=1, keepdims=True) | (margin == 0.0)
        met = data.alive & calm
        np.testing.assert_allclose(found.velocities[met], paper[met], atol=2e-4)
        reached = data.positions + DT * found.velocities, data.positions + DT * paper
        far, near = (np.hypot(*(place - GOAL).transpose(2, 0, 1)) for place in reached)
        lost = data.alive & one.shortfalls
        assert (far[lost] <= near[lost] + margin * math.sqrt(RHO) + 1e-6).all()


# --- the program


@pytest.mark.parametrize("corridor", [False, True])
def test_program_is_the_stated_one_with_every_formula_written_out(corridor: bool) -> None:
    data = window(1, 3, 3, seed=3)
    problem = both(data)[corridor]
    u = np.random.default_rng(4).normal(size=(3, 3, 2))
    f, g = (
        np.asarray(part).ravel()
        for part in problem.nlp.evaluate(u.ravel(), problem.instances.parameters[0])
    )
    counted = np.flatnonzero(data.alive[0]) if corridor else leaders_of(data)
    places = data.positions[0] + DT * u
    rates = [rate_by_hand(i, places[s], data.alive[0], RADARS) for s in range(3) for i in counted]
    assert f[0] == pytest.approx(sum(rates), rel=1e-12)
    v = np.diff(u, axis=0, prepend=np.zeros((1, 3, 2)))
    w = np.diff(v, axis=0, prepend=data.previous[:1])
    rows = [(w**2).sum(axis=-1).ravel(), v[1:].ravel()]
    if corridor:
        rows.append(((places - data.goals[:, None]) ** 2).sum(axis=-1).ravel())
    np.testing.assert_allclose(g, np.concatenate(rows), rtol=1e-12)


# --- known answers


def stopping(steps: int) -> Window:
    """A leader at speed 1, one unit from a guide that stands still; |v' - v| <= 0.5, dt = 1."""
    motion = Motion(v_max=2.0, a_max=0.25, dt=1.0)
    goals = np.tile([1.0, 0.0], (steps, 1))
    previous = np.array([[[1.0, 0.0]]])
    return Window(HAZARD, motion, np.zeros((1, 1, 2)), previous, np.ones((1, 1), bool), goals)


def test_leader_too_fast_for_its_guide_brakes_in_time_as_computed_by_hand() -> None:
    """One step ahead it flies there, cannot stop, and is 0.5 beyond. In view of three steps the
    squares (1 - x)^2 + (1.5 - 2x)^2 + 0 of its lags are least at x = 0.8: lags 0.2, -0.1, 0.
    """
    lags = {}
    for steps in (1, 3):
        data, worst = stopping(steps), []
        for _ in range(4):
            v = flown(data, leader_ahead(data, np.zeros(1, int)), make_solver("auto")).velocities
            data = replace(data, positions=data.positions + v, previous=v)
            worst.append(1.0 - data.positions[0, 0, 0])
        lags[steps] = worst
    np.testing.assert_allclose(lags[1], [0, -0.5, -0.5, 0], atol=1e-6)
    np.testing.assert_allclose(lags[3], [0.2, -0.1, 0, 0], atol=1e-5)


@pytest.mark.parametrize("steps", [2, 5, 8])
def test_nearest_paths_on_a_line_are_those_of_bounded_least_squares(steps: int) -> None:
    """On a line the discs of a_max are intervals of the changes of velocity: a convex QP."""
    rng = np.random.default_rng(5)
    data = window(1, 1, steps, seed=6)
    limits = replace(data.limits, speed=50.0)  # out of reach
    before = np.stack([rng.normal(0, 1, 30), np.zeros(30)], axis=1)
    goals = np.cumsum(rng.normal(0, 2, (30, steps)), axis=1)
    paths, failed = limits.following(before, np.stack([goals, 0 * goals], axis=-1), np.zeros(steps))
    assert not failed.any()
    total = np.tril(np.ones((steps, steps)))
    for b in range(30):
        without = before[b, 0] * np.arange(1, steps + 1)
        exact = lsq_linear(
            total @ total, goals[b] - without, (-limits.change, limits.change), tol=1e-14
        )
        np.testing.assert_allclose(paths[b, :, 0], without + total @ total @ exact.x, atol=2e-6)
    assert np.abs(paths[..., 1]).max() <= 1e-6


@pytest.mark.parametrize("radius", [0.0, 0.5])
def test_nearest_paths_are_those_of_ipopt(radius: float) -> None:
    rng = np.random.default_rng(7)
    limits = window(1, 1, 4, seed=0).limits
    before = rng.uniform(-1.9, 1.9, (12, 2))
    goals = np.cumsum(before[:, None] + rng.normal(0, 0.8, (12, 4, 2)), axis=1)
    goals += rng.normal(0, 0.7, (12, 1, 2))
    paths, failed = limits.following(before, goals, np.full(4, radius))
    assert not failed.any()
    for b in range(12):
        exact = _nearest_by_ipopt(before[b], goals[b], radius, limits.speed, limits.change)
        out = np.maximum(0.0, np.hypot(*(paths[b] - goals[b]).T) - radius)
        assert (out**2).sum() == pytest.approx(exact, abs=2e-6)


def _nearest_by_ipopt(
    before: Array, goals: Array, radius: float, speed: float, change: float
) -> float:
    """Least sum of squared distances to discs, by Opti with slack variables."""
    opti = ca.Opti()
    u, out = opti.variable(2, 4), opti.variable(4)
    velocity, place = before, ca.MX.zeros(2)
    for s in range(4):
        v = u[:, s] - place
        opti.subject_to(opti.bounded(-speed, v, speed))
        opti.subject_to(ca.sumsqr(v - velocity) <= change**2)
        opti.subject_to(ca.sumsqr(u[:, s] - goals[s]) <= (radius + out[s]) ** 2)
        velocity, place = v, u[:, s]
    opti.subject_to(out >= 0)
    opti.set_initial(out, 5.0)
    opti.minimize(ca.sumsqr(out))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-9})
    return float(opti.solve().value(ca.sumsqr(out)))


# --- against Ipopt, and the judge


@pytest.mark.parametrize("steps", [2, 3, 5])
def test_batch_solver_is_no_worse_than_ipopt_from_the_same_start(steps: int) -> None:
    data = window(12, 4, steps, seed=8)
    for problem in both(data):
        rows = np.flatnonzero(problem.free.any(axis=1))
        instances = problem.instances[rows]
        batch = Barrier().solve_batch(problem.nlp, instances)
        ipopt = make_solver("ipopt").solve(problem.nlp, instances)
        assert batch.success.all()
        solved = [solution.status.success for solution in ipopt]
        assert sum(solved) >= len(rows) - 2
        exact = np.array(
            [s.objective if ok else np.inf for s, ok in zip(ipopt, solved, strict=True)]
        )
        assert (batch.objective <= exact * (1 + 1e-6) + 1e-9).all()


def test_with_collisions_the_batch_solver_is_more_often_better_than_ipopt_than_worse() -> None:
    """Local minima abound; the batch solver has several starts, Ipopt the one."""
    data = replace(window(16, 4, 3, seed=9, deaths=0.1), hazard=COLLIDING)
    worse, better = 0, 0
    for problem in both(data):
        instances = problem.instances
        batch = make_solver("auto").solve_batch(problem.nlp, instances)
        ipopt = make_solver("ipopt").solve(problem.nlp, instances)
        exact = np.array([s.objective if s.status.success else np.inf for s in ipopt])
        worse += int((batch.objective > exact * (1 + 1e-6)).sum())
        better += int((batch.objective < exact * (1 - 1e-6)).sum())
    assert worse <= 6 < better


def test_residuals_and_multipliers_are_those_of_the_independent_judge() -> None:
    data = window(8, 4, 3, seed=10)
    for problem in both(data):
        rows = np.flatnonzero(problem.free.any(axis=1))
        instances = problem.instances[rows]
        run = Barrier().run(problem.nlp, instances)
        for i, answer in enumerate(run.answers()):
            found = judge(problem.nlp, instances[i : i + 1], answer.x, answer.multipliers)
            assert found.violation <= 1e-12
            unit = instances.units[i, 1] / instances.units[i, 0]  # type: ignore[index]
            assert found.stationarity <= unit * run.judged[i, 2] + 1e-9
            assert found.complementarity <= 1e-6
            low, high = answer.multipliers  # type: ignore[misc]
            estimated = judge(problem.nlp, instances[i : i + 1], answer.x)
            assert estimated.stationarity <= 1e-3
            assert (high[: 3 * 4] >= 0).all()
            assert np.isfinite(low).all()


# --- laws


@pytest.mark.parametrize("steps", [2, 4])
def test_limits_hold_along_the_path_and_to_rounding_in_what_is_flown(steps: int) -> None:
    data = window(30, 4, steps, seed=11, spread=0.6)
    for problem in both(data):
        v = velocities_of(paths_of(problem, data))[problem.free.any(axis=1)]
        assert np.abs(v).max() <= MOTION.v_max + 1e-9
        before = np.concatenate([data.previous[problem.free.any(axis=1)][:, None], v], axis=1)
        turns = (np.diff(before, axis=1) ** 2).sum(axis=-1)
        assert turns.max() <= MOTION.a_max + 1e-9
        decision = flown(data, problem, make_solver("auto"))
        assert not decision.failures.any()
        first = decision.velocities
        assert np.abs(first).max() <= MOTION.v_max + 1e-9
        turns = ((first - data.previous) ** 2).sum(axis=-1)
        assert turns[data.alive].max() <= MOTION.a_max + 1e-9
        assert (first[~data.alive] == 0).all()


def test_shortfalls_are_counted_where_the_next_wish_is_missed() -> None:
    data = window(40, 4, 3, seed=12)
    led, kept = both(data)
    for problem, wished, radius in (
        (led, np.arange(4) == leaders_of(data)[:, None], 0.0),
        (kept, data.alive, math.sqrt(RHO)),
    ):
        decision = flown(data, problem, make_solver("auto"))
        away = data.positions + DT * decision.velocities - data.goals[0]
        missed = np.hypot(away[..., 0], away[..., 1]) > radius + 1e-6 * MOTION.v_max * DT
        np.testing.assert_array_equal(decision.shortfalls, (missed & wished).sum(axis=1))
        assert 0 < decision.shortfalls.sum() < wished.sum()


def decisions(data: Window) -> list[Array]:
    return [flown(data, problem, make_solver("auto")).velocities for problem in both(data)]


def test_permutation_of_members_permutes_the_answer() -> None:
    data = window(6, 5, 3, seed=13)
    order = np.array([3, 0, 4, 1, 2])
    permuted = replace(
        data,
        positions=data.positions[:, order],
        previous=data.previous[:, order],
        alive=data.alive[:, order],
    )
    moved = np.asarray(order.argsort()[leaders_of(data)])
    here = both(data)
    there = [leader_ahead(permuted, moved), corridor_ahead(permuted, RHO)]
    for a, b in zip(here, there, strict=True):
        found = flown(data, a, make_solver("auto")).velocities
        again = flown(permuted, b, make_solver("auto")).velocities
        np.testing.assert_allclose(again, found[:, order], atol=1e-4)


def test_translation_of_everything_moves_nothing() -> None:
    data, shift = window(6, 4, 3, seed=14), np.array([7.0, -3.0])
    moved = replace(
        data,
        hazard=Saturation(tuple((x + 7.0, y - 3.0) for x, y in RADARS)),
        positions=data.positions + shift * data.alive[..., None],
        goals=data.goals + shift,
    )
    for a, b in zip(decisions(data), decisions(moved), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4)


@pytest.mark.parametrize("hazard", [HAZARD, COLLIDING], ids=["saturation", "collision"])
def test_destroyed_never_move_the_result(hazard: Saturation) -> None:
    data = replace(window(8, 4, 3, seed=15), hazard=hazard)
    dead = ~data.alive[..., None]
    elsewhere = replace(
        data,
        positions=np.where(dead, GOAL + 0.05, data.positions),
        previous=np.where(dead, 0.3, data.previous),
    )
    for a, b in zip(decisions(data), decisions(elsewhere), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


def test_batch_equals_one_by_one() -> None:
    data = window(7, 4, 3, seed=16)
    whole = decisions(data)
    for b in range(7):
        one = replace(
            data,
            positions=data.positions[b : b + 1],
            previous=data.previous[b : b + 1],
            alive=data.alive[b : b + 1],
        )
        for all_, alone in zip(whole, decisions(one), strict=True):
            np.testing.assert_array_equal(all_[b : b + 1], alone)


def test_lone_members_and_lone_leaders_are_decided_too() -> None:
    data = window(5, 1, 3, seed=17, deaths=0.0)
    for velocities in decisions(data):
        assert np.isfinite(velocities).all()
        assert np.abs(velocities).max() <= MOTION.v_max


def test_the_corridor_is_met_where_it_can_be_and_a_plan_s_rest_fits_the_next_window() -> None:
    """Flown window after window, members who have met every corridor go on to do so."""
    data = window(20, 3, 4, seed=18, spread=0.05, deaths=0.0)
    met = np.ones(20, bool)
    pace = 1.4 * np.stack([np.cos(0.25 * np.arange(12)), np.sin(0.25 * np.arange(12))], axis=1)
    way = GOAL + DT * np.concatenate([np.zeros((1, 2)), np.cumsum(pace[1:], axis=0)])
    short = []
    for t in range(8):
        now = replace(data, goals=way[t : t + 4])
        decision = flown(now, corridor_ahead(now, RHO), make_solver("auto"))
        X = data.positions + DT * decision.velocities
        data = replace(data, positions=X, previous=decision.velocities)
        short.append(decision.shortfalls)
        met &= decision.shortfalls == 0
    assert met.sum() >= 10
    assert sum(short[4:]).sum() == 0


# --- rates that are no kernels, solvers, pickling, names


def test_rates_that_are_no_kernels_are_solved_by_ipopt() -> None:
    scenario = cs.load_scenario("paper-1").with_values(
        {
            "hazard": {"kind": "small_scenarios:patrolled", "radars": [[4.4, 4.6]]},
            "swarm.positions": [[0.0, 0.0], [0.3, 0.0]],
        }
    )
    guide = cs.plan(scenario, certify=False)
    policy = make_policy("constrained", scenario, guide, look_ahead=2)
    X = scenario.positions[None]
    decision = policy.decide(0, X, np.tile(guide.velocities[0], (1, 2, 1)), np.ones((1, 2), bool))
    assert not decision.failures.any()
    assert not decision.resolved.any()


def test_solvers_of_other_problems_say_that_they_cannot() -> None:
    problem = both(window(2, 3, 2, seed=19))[0]
    with pytest.raises(SolverError, match="spectral cannot take look-ahead"):
        make_solver("spectral").solve_batch(problem.nlp, problem.instances)
    step = window(2, 3, 1, seed=19)
    data = Step(HAZARD, MOTION, step.positions, step.previous, step.alive, GOAL)
    formation = corridor_formation(data, RHO)
    with pytest.raises(SolverError, match="needs paths within limits"):
        Barrier().solve_batch(formation.nlp, formation.instances)


def test_policies_and_problems_pickle() -> None:
    scenario = cs.load_scenario("paper-1")
    guide = cs.plan(scenario, certify=False)
    policy = make_policy("leader-ahead-3", scenario, guide)
    assert policy.name == "leader-ahead-3"
    X = scenario.positions[None]
    state = (0, X, np.tile(guide.velocities[0], (1, 5, 1)), np.ones((1, 5), bool))
    again = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(again.velocities(*state), policy.velocities(*state))


@pytest.mark.parametrize(
    ("name", "look_ahead", "words"),
    [
        ("leader", 0, "look_ahead = 0; allowed: whole numbers from 1"),
        ("leader", 2.5, "look_ahead = 2.5"),
        ("naive", 3, "'naive' has no look-ahead"),
        ("leader-ahead-0", 1, "look_ahead = 0"),
        ("leader-ahead-3", 2, "names its look-ahead"),
        ("leader-ahead-H", 1, "'leader-ahead-H' is unknown; .*leader-ahead-3"),
        ("leader-ahead-", 1, "unknown"),
        ("naive-ahead-3", 1, "unknown"),
    ],
)
def test_wrong_look_aheads_are_told(name: str, look_ahead: int, words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        make_policy(name, cs.load_scenario("paper-1"), look_ahead=look_ahead)


# --- what it buys


def test_looking_ahead_avoids_most_shortfalls_of_the_corridor() -> None:
    scenario = cs.load_scenario("paper-1")
    guide = cs.plan(scenario, certify=False)
    study = cs.simulate(scenario, ["constrained", "constrained-ahead-5"], 40, guide=guide)
    near, far = study.summary["shortfalls"]
    assert far < 0.4 * near
    assert not study.summary["solver_failures"].any()


def test_leader_ahead_is_a_leader() -> None:
    scenario = cs.load_scenario("paper-1")
    policy = make_policy("leader", scenario, succession="first", look_ahead=2)
    assert isinstance(policy, LeaderAheadPolicy)
    assert isinstance(policy, LeaderPolicy)
    assert policy.succession == "first"


def test_commands_take_several_look_aheads_side_by_side(tmp_path: Path) -> None:
    names = ["leader", "leader-ahead-2", "constrained-ahead-3"]
    policies = [word for name in names for word in ("--policy", name)]
    told = casswarm(tmp_path, "simulate", "paper-1", *policies, "--runs", 20, "--quiet").stdout
    assert all(f"\n{name} " in told for name in names)
    told = casswarm(
        tmp_path, "evaluate", "paper-1", *policies[2:], "--tolerance", 0.2, "--merge", 1e-6
    ).stdout
    assert "leader-ahead-2 " in told
    assert "constrained-ahead-3 " in told
    words = ("simulate", "paper-1", "--policy", "leader-ahead-x", "--runs", 5)
    assert "leader-ahead-3" in casswarm(tmp_path, *words, code=2).stderr


def test_chart_has_success_above_and_shortfalls_below_for_every_scenario() -> None:
    table = pd.DataFrame(
        {
            "scenario": ["a", "a", "b", "b"],
            "policy": ["leader"] * 4,
            "look_ahead": [1, 3, 1, 3],
            "success": [0.2, 0.5, 0.1, 0.4],
            "success_low": [0.1, 0.4, 0.1, 0.3],
            "success_high": [0.3, 0.6, 0.1, 0.5],
            "shortfalls": [8.0, 1.0, 4.0, 0.0],
        }
    )
    axes = look_ahead_chart(table).axes
    assert [panel.get_title() for panel in axes] == ["a", "b", "", ""]
    np.testing.assert_array_equal(axes[2].lines[0].get_xydata(), [[1, 8], [3, 1]])
    np.testing.assert_array_equal(axes[1].lines[0].get_xydata(), [[1, 0.1], [3, 0.4]])

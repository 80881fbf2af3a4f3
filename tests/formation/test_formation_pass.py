"""Formation policies in one pass: the same decisions as from records, state by state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from formation_cases import HAZARDS
from hypothesis import given, settings
from hypothesis import strategies as st
from window_cases import MOTION, RHO

from casswarm.formation import (
    Auto,
    FormationTask,
    SpectralProjectedGradient,
    decide_states,
    or_none,
)
from casswarm.hazard import Hazard
from casswarm.motion import PlanarSets, Step
from casswarm.policies import Decision, applied_decision
from casswarm.policies.formation_policies import formation_decision

GOAL = np.array([3.0, 2.5])
KINDS = ("leader", "corridor", "led corridor")


def task(
    kind: str, hazard: Hazard, batch: int, n: int, seed: int, spread: float = 0.2
) -> FormationTask:
    """Problems of random states: destroyed members, some at the goal, at rest or at one point."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, n)) < 0.8
    velocities = rng.uniform(-1.2, 1.2, (batch, 1, 2)) + rng.normal(0.0, spread, (batch, n, 2))
    velocities[rng.random((batch, n)) < 0.1] = 0.0
    velocities = velocities.clip(-2.0, 2.0)
    positions = GOAL - MOTION.dt * velocities + rng.normal(0.0, spread, (batch, n, 2))
    positions[rng.random((batch, n)) < 0.1] = GOAL
    shown = alive[..., None]
    step = Step(hazard, MOTION, positions * shown, velocities * shown, alive, GOAL[None])
    leaders = alive.argmax(axis=1)
    if kind == "leader":
        return FormationTask(step, leaders)
    return FormationTask(step, leaders if "led" in kind else or_none(None, batch), RHO)


def assert_equal(found: Decision, expected: Decision) -> None:
    for name in ("velocities", "infeasible", "failures", "fallbacks"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def from_records(problem: FormationTask, solver: Auto) -> Decision:
    return applied_decision(problem.step, problem.formation(), solver)


@pytest.mark.parametrize(("hazard", "most"), [("plain", 20), ("collision", 6)])
@settings(max_examples=40, deadline=None)
@given(data=st.data(), kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1))
def test_pass_equals_records_to_the_bit(
    hazard: str, most: int, data: st.DataObject, kind: str, seed: int
) -> None:
    n, spread = data.draw(st.integers(1, most)), data.draw(st.sampled_from([0.0, 0.02, 0.2, 1.0]))
    problem = task(kind, HAZARDS[hazard], 6, n, seed, spread)
    assert_equal(formation_decision(problem, Auto()), from_records(problem, Auto()))


@pytest.mark.parametrize("hazard", HAZARDS)
@pytest.mark.parametrize("kind", KINDS)
def test_decision_of_a_state_does_not_depend_on_its_batch(kind: str, hazard: str) -> None:
    problem = task(kind, HAZARDS[hazard], 12, 4, seed=1)
    order = np.random.default_rng(2).permutation(12)
    whole, permuted = (formation_decision(p, Auto()) for p in (problem, problem[order]))
    np.testing.assert_array_equal(permuted.velocities, whole.velocities[order])
    for row in range(12):
        single = formation_decision(problem[np.array([row])], Auto())
        np.testing.assert_array_equal(single.velocities[0], whole.velocities[row])
        assert single.infeasible[0] == whole.infeasible[row]


def test_threads_decide_as_one_does() -> None:
    problem = task("corridor", HAZARDS["plain"], 2200, 5, seed=3)
    whole = formation_decision(problem, Auto())
    parts = [formation_decision(problem[rows], Auto()) for rows in np.split(np.arange(2200), 11)]
    np.testing.assert_array_equal(whole.velocities, np.concatenate([p.velocities for p in parts]))
    assert whole.infeasible.sum() == sum(part.infeasible.sum() for part in parts) > 0


def test_leader_protection_without_collisions_is_its_closed_form() -> None:
    problem = task("leader", HAZARDS["plain"], 300, 5, seed=4)
    step, rows = problem.step, np.arange(300)
    decision = formation_decision(problem, Auto())
    lead, previous = step.positions[rows, problem.leaders], step.previous_velocities
    velocity = MOTION.toward(lead, previous[rows, problem.leaders], GOAL)
    following = lead + MOTION.dt * velocity
    expected = MOTION.toward(step.positions, previous, following[:, None])
    expected[rows, problem.leaders] = velocity
    expected = np.where(step.alive[..., None], expected, 0.0)
    np.testing.assert_allclose(decision.velocities, expected, atol=1e-12)
    living = step.alive.any(axis=1)
    np.testing.assert_array_equal(decision.infeasible, MOTION.misses(lead, velocity, GOAL) & living)
    assert not decision.fallbacks.any()


def test_corridor_sets_are_those_of_box_discs_and_relaxation() -> None:
    problem = task("corridor", HAZARDS["plain"], 200, 5, seed=5, spread=0.4)
    step, formation = problem.step, problem.formation()
    to_goal = (GOAL - step.positions) / MOTION.dt
    expected, infeasible = PlanarSets(
        np.full(2, -2.0),
        np.full(2, 2.0),
        np.stack([step.previous_velocities, to_goal], axis=-2),
        np.sqrt([0.5, RHO]) / [1.0, MOTION.dt],
    ).relax_infeasible()
    living = step.alive
    assert 0 < infeasible[living].sum() < living.sum()
    np.testing.assert_array_equal(formation.infeasible, infeasible & living)
    np.testing.assert_array_equal(formation.free, ~infeasible & living)
    for name in ("lower", "upper", "centers", "radii"):
        found, wanted = getattr(formation.sets, name), getattr(expected, name)
        np.testing.assert_allclose(found[living], wanted[living], rtol=1e-14, atol=1e-14)
    assert not formation.sets.upper[~living].any()
    assert not formation.sets.lower[~living].any()


def test_states_above_tolerance_are_solved_again_by_ipopt_and_counted() -> None:
    problem = task("corridor", HAZARDS["plain"], 8, 4, seed=6, spread=0.05)
    solver = Auto(batch=SpectralProjectedGradient(max_iter=1))
    decision = formation_decision(problem, solver)
    assert decision.fallbacks.any()
    assert not decision.failures.any()
    assert_equal(decision, from_records(problem, solver))
    converged = formation_decision(problem, Auto())
    assert not converged.fallbacks.any()
    np.testing.assert_allclose(decision.velocities, converged.velocities, atol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("value", [np.nan, np.inf, 5.0])
def test_state_without_a_problem_is_refused(kind: str, value: float) -> None:
    problem = task(kind, HAZARDS["plain"], 3, 3, seed=7)
    alive, previous = np.ones((3, 3), bool), problem.step.previous_velocities.copy()
    previous[1, 2, 0] = value
    problem = replace(
        problem, step=replace(problem.step, alive=alive, previous_velocities=previous)
    )
    with pytest.raises(ValueError, match="1 of 1 states have no formation problem"):
        formation_decision(problem, Auto())


def test_pass_is_compiled_once() -> None:
    for hazard in HAZARDS.values():
        for kind in KINDS:
            for n in (1, 3):
                formation_decision(task(kind, hazard, 2, n, seed=8), Auto())
    assert len(decide_states.entry.signatures) == 1  # type: ignore[attr-defined]

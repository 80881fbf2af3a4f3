"""Velocities do not depend on units, axes, the origin, order, destroyed members, or the batch."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from formation_cases import disc
from small_scenarios import Array
from window_cases import COLLIDING, GOAL, HAZARD, RHO, leaders_of, window

from casswarm import Saturation, make_solver
from casswarm.formation import (
    Auto,
    Formation,
    SpectralProjectedGradient,
    corridor_formation,
    corridor_mpc_formation,
    leader_formation,
    leader_mpc_formation,
)
from casswarm.motion import Motion, Step
from casswarm.policies import applied_decision
from casswarm.solvers import Solver


class Method(NamedTuple):
    """A solver, states, and by how much velocities in images of them may differ."""

    solver: Solver
    step: Step
    atol: float
    exact: float = 0.0  # where only data of destroyed members differ
    rho: float = RHO


METHODS = {
    "ipopt": Method(make_solver("ipopt"), window(6, 5, 1, seed=11), 1e-5, 1e-9),
    "auto": Method(Auto(), window(6, 5, 1, seed=12, spread=0.2), 1e-5, 1e-9),
    "large swarm": Method(SpectralProjectedGradient(1e-10), disc(60), 1e-6, rho=0.6),
    "horizon": Method(Auto(), window(6, 5, 3, seed=13), 1e-4, 1e-7),
}
IMAGES: dict[str, dict[str, Any]] = {
    "order": {"roll": 2},
    "turned": {"matrix": np.array([[0.0, 1.0], [-1.0, 0.0]])},
    "mirrored": {"matrix": np.diag([1.0, -1.0])},
    "shifted": {"shift": np.array([-7.0, 3.0])},
    "in thousandths": {"length": 1000.0},
}


def image(
    step: Step,
    matrix: Array | None = None,
    shift: Array | float = 0.0,
    length: float = 1.0,
    risk: float = 1.0,
    roll: int = 0,
) -> Step:
    """The same states with other axes, another origin, in other units, or in another order."""
    turn = length * (np.eye(2) if matrix is None else matrix)
    hazard, motion = step.hazard, step.motion
    order = np.roll(np.arange(step.alive.shape[1]), roll)
    assert isinstance(hazard, Saturation)
    rates = replace(
        hazard,
        radars=tuple(map(tuple, hazard.radar_positions @ turn + shift)),
        alpha_1=hazard.alpha_1 * risk * length**2,
        alpha_3=hazard.alpha_3 / length**2,
        core_radius=hazard.core_radius * length,
    )
    return Step(
        rates,
        Motion(motion.v_max * length, motion.a_max * length**2, motion.dt),
        (step.positions @ turn + shift)[:, order],
        (step.previous_velocities @ turn)[:, order],
        step.alive[:, order],
        step.goals @ turn + shift,
    )


def problems(step: Step, leaders: Any, rho: float = RHO) -> list[Formation]:
    """Leader protection and the corridor, over one step or several."""
    if step.horizon == 1:
        return [leader_formation(step, leaders), corridor_formation(step, rho)]
    return [leader_mpc_formation(step, leaders), corridor_mpc_formation(step, rho)]


@pytest.mark.parametrize("name", IMAGES)
@pytest.mark.parametrize("method", METHODS)
def test_velocities_of_image_are_image_of_velocities(method: str, name: str) -> None:
    solver, step, atol, _, rho = METHODS[method]
    seen, leaders = image(step, **IMAGES[name]), leaders_of(step)
    length = IMAGES[name].get("length", 1.0)
    n, roll = step.alive.shape[1], IMAGES[name].get("roll", 0)
    order, moved = np.roll(np.arange(n), roll), (leaders + roll) % n
    pairs = zip(problems(step, leaders, rho), problems(seen, moved, rho * length**2), strict=True)
    for here, there in pairs:
        found, again = applied_decision(step, here, solver), applied_decision(seen, there, solver)
        assert not found.failures.any()
        assert not again.failures.any()
        expected = found.velocities @ IMAGES[name].get("matrix", np.eye(2))
        np.testing.assert_allclose(again.velocities / length, expected[:, order], atol=atol)
        np.testing.assert_array_equal(there.infeasible, here.infeasible[:, order])
        np.testing.assert_array_equal(again.infeasible, found.infeasible)


@pytest.mark.parametrize("length", [1e-2, 1e4])
@pytest.mark.parametrize("risk", [1e-6, 1e3])
@pytest.mark.parametrize("corridor", [False, True])
def test_objectives_are_independent_of_units(corridor: bool, length: float, risk: float) -> None:
    """Lengths in other units, and rates in other units of time, give the same answers."""
    step = window(60, 5, 1, seed=0, spread=0.2)
    seen = image(step, length=length, risk=risk)
    one = problems(step, leaders_of(step))[corridor]
    other = problems(seen, leaders_of(step), RHO * length**2)[corridor]
    np.testing.assert_array_equal(other.infeasible, one.infeasible)
    answers = [Auto().solve_batch(each.nlp, each.instances) for each in (one, other)]
    assert answers[1].success.all()
    expected = risk * answers[0].objective
    np.testing.assert_allclose(answers[1].objective, expected, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("hazard", [HAZARD, COLLIDING], ids=["saturation", "collision"])
@pytest.mark.parametrize("method", ["ipopt", "auto", "horizon"])
def test_destroyed_members_do_not_influence_velocities(method: str, hazard: Saturation) -> None:
    solver, step, _, exact, _ = METHODS[method]
    here, dead = replace(step, hazard=hazard), ~step.alive[..., None]
    assert dead.any()
    noise = np.random.default_rng(10).normal(0, 0.1, (2, *step.positions.shape))
    there = replace(
        here,
        positions=np.where(dead, GOAL + noise[0], step.positions),
        previous_velocities=np.where(dead, noise[1], step.previous_velocities),
    )
    for one, other in zip(
        *(problems(each, leaders_of(step)) for each in (here, there)), strict=True
    ):
        found, again = applied_decision(here, one, solver), applied_decision(there, other, solver)
        assert (found.velocities[~step.alive] == 0).all()
        np.testing.assert_allclose(again.velocities, found.velocities, atol=exact)
        np.testing.assert_array_equal(other.infeasible, one.infeasible)
        assert not one.infeasible[~step.alive].any()


@pytest.mark.parametrize(
    ("solver", "step"),
    [
        (SpectralProjectedGradient(), window(700, 5, 1, 0, 0.2, hazard=COLLIDING)),  # two threads
        (Auto(), window(700, 5, 1, 0, 0.2, hazard=COLLIDING)),
        (Auto(), window(7, 4, 3, seed=16)),
    ],
    ids=["spectral", "auto", "horizon"],
)
def test_answers_are_independent_of_batch(solver: Solver, step: Step) -> None:
    batch = len(step.alive)
    order, some = np.random.default_rng(0).permutation(batch), range(0, batch, batch // 7)
    for problem in problems(step, leaders_of(step)):
        nlp, instances = problem.nlp, problem.instances
        together = solver.solve_batch(nlp, instances).x
        shuffled = solver.solve_batch(nlp, instances[order]).x
        np.testing.assert_array_equal(shuffled, together[order])
        for i in some:
            alone = solver.solve_batch(nlp, instances[i : i + 1]).x
            np.testing.assert_array_equal(alone[0], together[i])

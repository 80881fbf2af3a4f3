"""The batch solver on the corridor problem of large swarms."""

from dataclasses import replace

import numpy as np
import pytest

import casswarm as csw
from casswarm.formation import Auto, SpectralProjectedGradient, corridor_formation
from casswarm.formation.spectral_kernels import invert_blocks, precondition
from casswarm.motion import Motion, Step
from casswarm.solvers import Ipopt

MOTION = Motion(v_max=2.0, a_max=0.5, dt=0.33)
HAZARD = csw.Saturation(((4.4, 4.6), (4.5, 3.0)), alpha_1=4.0, alpha_2=3.0, alpha_3=4.0)
PACE = np.array([0.8, 0.8])


def swarm(n, seed=0, area=0.01):
    """A step of n members at random in a disc, and the squared radius of its corridor."""
    rng, squared = np.random.default_rng(seed), area * n
    radius = 1.1 * np.sqrt(squared * rng.random(n))
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    positions = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    velocities = PACE + rng.normal(0.0, 0.2, (1, n, 2))
    goal = positions.mean(axis=0) + MOTION.dt * PACE
    return Step(HAZARD, MOTION, positions[None], velocities, np.ones((1, n), bool), goal[None]), (
        squared
    )


def velocities(step, squared, solver=None):
    formation = corridor_formation(step, squared)
    found = (solver or SpectralProjectedGradient(1e-10)).solve_batch(
        formation.nlp, formation.instances
    )
    assert found.success.all()
    return found.x.reshape(step.positions.shape), found


@pytest.mark.parametrize("n", [5, 20])
def test_scale_is_the_rate_of_isolated_members(n):
    step, squared = swarm(n)
    scale = corridor_formation(step, squared).instances.scale
    expected = HAZARD.single_agent_rates(step.positions).sum(axis=1)
    np.testing.assert_allclose(scale, [[MOTION.v_max, expected[0]]], rtol=1e-13)


@pytest.mark.parametrize("seed", range(3))
def test_objective_of_fifty_members_equals_ipopts(seed):
    assert_objective_equals_ipopts(*swarm(50, seed))


@pytest.mark.parametrize("seed", range(3))
def test_objective_in_a_wide_corridor_is_no_worse_than_ipopts(seed):
    step, squared = swarm(50, seed, area=0.075)  # these have several minima
    _, found = velocities(step, squared)
    _, expected = velocities(step, squared, Ipopt(tolerance=1e-12))
    assert found.objective[0] <= (1 + 1e-6) * expected.objective[0]


def assert_objective_equals_ipopts(step, squared):
    _, found = velocities(step, squared)
    _, expected = velocities(step, squared, Ipopt(tolerance=1e-12))
    assert found.objective == pytest.approx(expected.objective, rel=1e-6)


@pytest.mark.slow
def test_objective_of_two_hundred_members_equals_ipopts():
    assert_objective_equals_ipopts(*swarm(200))


@pytest.mark.parametrize("n", [50, 200])
def test_large_swarms_are_stationary_and_feasible(n):
    _, found = velocities(*swarm(n), Auto())
    assert not found.used_fallback.any()
    assert found.stationarity.max() <= 1e-6
    assert found.violation.max() <= 1e-9


@pytest.mark.slow
def test_thousand_members_are_stationary_and_feasible():
    test_large_swarms_are_stationary_and_feasible(1000)


def test_velocities_permute_with_the_members():
    step, squared = swarm(60)
    order = np.random.default_rng(1).permutation(60)
    permuted = replace(
        step,
        positions=step.positions[:, order],
        previous_velocities=step.previous_velocities[:, order],
    )
    expected, _ = velocities(step, squared)
    np.testing.assert_allclose(velocities(permuted, squared)[0], expected[:, order], atol=1e-6)


def test_velocities_turn_with_the_plane():
    step, squared = swarm(60)
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    turned = replace(
        step,
        hazard=replace(HAZARD, radars=tuple(map(tuple, HAZARD.radar_positions @ turn))),
        positions=step.positions @ turn,
        previous_velocities=step.previous_velocities @ turn,
        goals=step.goals @ turn,
    )
    expected, _ = velocities(step, squared)
    np.testing.assert_allclose(velocities(turned, squared)[0], expected @ turn, atol=1e-6)


def test_velocities_are_independent_of_the_origin():
    step, squared = swarm(60)
    shift = np.array([3.0, -7.0])
    moved = replace(
        step,
        hazard=replace(HAZARD, radars=tuple(map(tuple, HAZARD.radar_positions + shift))),
        positions=step.positions + shift,
        goals=step.goals + shift,
    )
    expected, _ = velocities(step, squared)
    np.testing.assert_allclose(velocities(moved, squared)[0], expected, atol=1e-6)


def test_velocities_scale_with_the_unit_of_length():
    step, squared = swarm(60)
    unit = 1000.0
    hazard = csw.Saturation(
        tuple(map(tuple, unit * HAZARD.radar_positions)),
        alpha_1=4.0 * unit**2,
        alpha_2=3.0,
        alpha_3=4.0 / unit**2,
        core_radius=unit * HAZARD.core_radius,
    )
    scaled = Step(
        hazard,
        Motion(unit * MOTION.v_max, unit**2 * MOTION.a_max, MOTION.dt),
        unit * step.positions,
        unit * step.previous_velocities,
        step.alive,
        unit * step.goals,
    )
    expected, _ = velocities(step, squared)
    found, _ = velocities(scaled, unit**2 * squared)
    np.testing.assert_allclose(found / unit, expected, atol=1e-6)


def test_preconditioner_inverts_the_magnitudes_of_curvatures_on_the_face():
    free, tangent = np.array([[3.0, 1.0], [1.0, -2.0]]), np.array([0.6, 0.8])
    blocks = np.array([3.0, 1.0, -2.0, 1.0, 0.5, 4.0, 1.0, 0.0, 1.0])
    face = np.array([[2.0, 0.0, 0.0, 0.0], [1.0, *tangent, 2.0], [0.0, 0.0, 0.0, 0.0]])
    vector, out = np.array([1.0, 2.0, 3.0, -1.0, 5.0, 6.0]), np.empty(6)
    product = precondition(vector, _inverted(blocks, face), out)
    values, axes = np.linalg.eigh(free)
    expected = (axes / np.abs(values)) @ axes.T @ vector[:2]
    np.testing.assert_allclose(out[:2], expected, rtol=1e-12)
    along = tangent @ np.array([[1.0, 0.5], [0.5, 4.0]]) @ tangent + 2.0
    np.testing.assert_allclose(out[2:4], (tangent @ vector[2:4]) / along * tangent, rtol=1e-12)
    np.testing.assert_array_equal(out[4:], 0.0)
    assert product == pytest.approx(vector @ out, rel=1e-12)


def _inverted(blocks, face):
    inverse = blocks.copy()
    invert_blocks(inverse, face)
    return inverse

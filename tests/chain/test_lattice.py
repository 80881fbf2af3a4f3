"""Motion on a lattice: its limits, and exact laws against brute force that aggregates nothing."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from brute_force import law_by_hand, success_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binomtest
from small_scenarios import Array, small, three_members

import casswarm as csw
from casswarm.chain import Chain, Lattice
from casswarm.errors import PolicyError
from casswarm.guide import initial_velocities
from casswarm.motion import Motion
from casswarm.policies import Policy
from casswarm.policies.base import SOLVER_TOL

RADARS = [(1.0, 0.4)]
MOTION = Motion(2.0, 0.5, 0.33)
SIX_STEPS = small(
    [(0.0, 0.0), (0.3, 0.2)], (2.6, 0.0), RADARS, 6, hazard__alpha_1=3.0, guide__a_max=0.05
)


@pytest.fixture(scope="module")
def guide() -> csw.Guide:
    """Guide of three members."""
    return csw.plan(three_members(), certify=False)


def lattice(spacing: float, path: Array) -> Lattice:
    return Lattice(path, spacing, MOTION.dt, MOTION.v_max)


@st.composite
def moves(draw: st.DrawFn) -> tuple[Lattice, Array, Array, Array]:
    """A lattice, positions on and off it, previous velocities, and commands at their limits."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    spacing = 2.0 ** -draw(st.integers(6, 24))
    path = rng.uniform(-3.0, 3.0, (2, 2))
    shape = (7, 3, 2)
    positions = path[0] + spacing * np.rint(rng.uniform(-3.0, 3.0, shape) / spacing)
    if draw(st.booleans()):
        positions += rng.uniform(-1.0, 1.0, shape) * spacing
    previous = np.clip(rng.uniform(-1.3, 1.3, shape), -1.0, 1.0) * MOTION.v_max
    commands = previous + rng.uniform(-1.2, 1.2, shape)
    return lattice(spacing, path), positions, previous, MOTION.sets(previous).project(commands)


@given(moves())
@settings(max_examples=40, deadline=None)
def test_lattice_moves_respect_limits_and_stay_near_commands(
    case: tuple[Lattice, Array, Array, Array],
) -> None:
    given, positions, previous, commands = case
    sets = MOTION.sets(previous)
    velocities, following = given.moved(0, positions, commands, sets)
    assert sets.violation(velocities).max() <= 1e-12 * MOTION.v_max
    np.testing.assert_allclose(following, positions + MOTION.dt * velocities, atol=1e-13)
    offset = np.abs(MOTION.dt * (velocities - commands)).max(axis=-1) / given.spacing
    assert offset.max() <= 1.5 + 1e-6
    nodes = (following - given.path[1]) / given.spacing
    on = (following == given.path[1] + given.spacing * np.rint(nodes)).all(axis=-1)
    assert on[offset > 0].all()
    nearest = given.path[1] + given.spacing * np.rint(
        (positions + MOTION.dt * commands - given.path[1]) / given.spacing
    )
    allowed = sets.violation((nearest - positions) / MOTION.dt) <= 0.9e-12 * MOTION.v_max
    np.testing.assert_array_equal(following[allowed], nearest[allowed])


def test_lattice_positions_depend_on_nothing_but_their_indices() -> None:
    """Two histories that meet within rounding continue equally, to the last bit."""
    rng, path = np.random.default_rng(3), np.array([[0.1, 0.7], [1.3, -0.2], [1.9, 0.4]])
    given, start = lattice(1e-6, path), rng.uniform(-1.0, 1.0, (50, 1, 2))
    sets = MOTION.sets(np.zeros((50, 1, 2)))
    target = path[1] + 1e-6 * np.rint(rng.uniform(-0.05, 0.05, (1, 1, 2)) / 1e-6)
    near = target + rng.uniform(-4e-7, 4e-7, (50, 1, 2))
    wide = Motion(100.0, 1e4, MOTION.dt).sets(np.zeros((50, 1, 2)))
    _, met = given.moved(0, start, (near - start) / MOTION.dt, wide)
    assert len(np.unique(met, axis=0)) == 1
    velocities, following = given.moved(1, met, np.full_like(met, 0.123), sets)
    assert len(np.unique(following, axis=0)) == len(np.unique(velocities, axis=0)) == 1


def test_member_on_the_guide_stays_exactly_on_it(guide: csw.Guide) -> None:
    scenario = three_members()
    given = Lattice.along(guide, scenario, None, SOLVER_TOL)
    assert given is not None
    assert given.spacing == SOLVER_TOL * scenario.swarm.v_max * scenario.time.dt
    for step in range(guide.arrival):
        here = guide.reference(step).reshape(1, 1, 2)
        velocity = (guide.reference(step + 1) - here) / scenario.time.dt
        _, following = given.moved(step, here, velocity, MOTION.sets(velocity))
        np.testing.assert_array_equal(following[0, 0], guide.reference(step + 1))


@pytest.mark.parametrize("spacing", [1e-20, 0.1, np.inf, np.nan, -1.0])
def test_lattice_refuses_spacings_without_meaning(spacing: float, guide: csw.Guide) -> None:
    with pytest.raises(PolicyError, match=r"aggregation_tol = .*; allowed: 0, .* to 0.0292"):
        csw.evaluate(three_members(), "leader", 0.5, guide=guide, aggregation_tol=spacing)


def test_default_lattice_keeps_to_double_precision_far_from_the_origin() -> None:
    """Where default spacings would be lost in rounding, they are wider."""
    far = small([(1e7, 0.0), (1e7 + 0.3, 0.2)], (1e7 + 1.8, 0.0), [(1e7 + 1.0, 0.4)], 4)
    guide = csw.plan(far, certify=False)
    given = Lattice.along(guide, far, None, SOLVER_TOL)
    assert given is not None
    assert given.spacing == pytest.approx(1e-6, rel=0.01)
    assert Lattice.along(guide, far, None, 0.0) is None


# --- laws


def brute_force(scenario: csw.Scenario, policy: Policy, before: Array, given: Lattice) -> float:
    """Success probability by recursion over all fates.

    Commands are rounded by a search of the points around: the nearest that is allowed.
    """
    motion, dt = Motion.from_scenario(scenario), scenario.time.dt
    around = np.array(list(product(range(-2, 3), repeat=2)))

    def rounded(step: int, x: Array, velocity: Array, previous: Array) -> Array:
        node = np.rint((x + dt * velocity - given.path[step + 1]) / given.spacing)
        points = given.path[step + 1] + given.spacing * (node + around)
        candidates = (points - x) / dt
        change = np.hypot(*(candidates - previous).T)
        allowed = (np.abs(candidates).max(axis=1) <= motion.v_max * (1 + 1e-12)) & (
            change <= motion.max_change + 1e-12 * motion.v_max
        )
        distance = np.hypot(*(points - x - dt * velocity).T)
        return points[np.where(allowed, distance, np.inf).argmin()]

    def move(step: int, x: Array, previous: Array, alive: NDArray[np.bool_]) -> Array:
        velocities, following = policy.velocities(step, x, previous, alive), np.zeros_like(x)
        for i in np.flatnonzero(alive):
            following[i] = rounded(step, x[i], velocities[i], previous[i])
        return following

    return success_of(law_by_hand(scenario, before, move))


@pytest.mark.parametrize("policy", ["leader", "constrained", "naive"])
@pytest.mark.parametrize("spacing", [1e-7, 1e-3, 0.02])
def test_evaluate_on_a_lattice_agrees_with_brute_force(policy: str, spacing: float) -> None:
    guide = csw.plan(SIX_STEPS, certify=False)
    given = Lattice.along(guide, SIX_STEPS, spacing)
    assert given is not None
    made = csw.make_policy(policy, SIX_STEPS, guide)
    truth = brute_force(SIX_STEPS, made, initial_velocities(SIX_STEPS, guide), given)
    options = {"guide": guide, "aggregation_tol": spacing}
    law = csw.evaluate(SIX_STEPS, made, 0.0, **options)
    assert 0.05 < truth < 0.95
    assert law.aggregation_tol == spacing
    np.testing.assert_allclose(law.success, truth, atol=1e-9)
    rough = csw.evaluate(SIX_STEPS, made, 0.0, max_states=8, **options)
    assert rough.residual_mass > 1e-4
    assert rough.success.low - 1e-9 <= truth <= rough.success.high + 1e-9


def test_evaluate_on_a_coarse_lattice_agrees_with_runs_on_it() -> None:
    scenario, runs = three_members(hazard__alpha_1=8.0), 20_000
    guide = csw.plan(scenario, certify=False)
    given = Lattice.along(guide, scenario, 0.02)
    policy = csw.make_policy("constrained", scenario, guide)
    law = csw.evaluate(scenario, policy, 1e-4, guide=guide, aggregation_tol=0.02)
    assert law.complete
    chain = Chain(scenario, initial_velocities(scenario, guide), 5, lattice=given)
    successes = int((chain.run(policy, 0, runs).arrival >= 0).sum())
    interval = binomtest(successes, runs).proportion_ci(0.999, method="wilson")
    assert interval.low <= law.success.high
    assert law.success.low <= interval.high


@pytest.mark.slow
def test_default_lattice_needs_a_tenth_of_the_states() -> None:
    scenario = csw.load_scenario("paper-1")
    guide = csw.plan(scenario, certify=False)
    exact = csw.evaluate(scenario, "constrained", 1e-2, guide=guide, aggregation_tol=0.0)
    law = csw.evaluate(scenario, "constrained", 1e-2, guide=guide)
    assert exact.aggregation_tol == 0.0 < law.aggregation_tol < 1e-7
    assert law.complete
    assert 10 * law.states < exact.states
    assert max(law.success.low, exact.success.low) <= min(law.success.high, exact.success.high)


def test_policies_without_a_solver_are_not_rounded(guide: csw.Guide) -> None:
    assert csw.evaluate(three_members(), "naive", 0.1, guide=guide).aggregation_tol == 0.0


def test_law_of_gathered_members_does_not_depend_on_rounding() -> None:
    """Members gather where their leader is; ties among them were decided by the last digits."""
    scenario = csw.load_scenario("ring")
    guide = csw.plan(scenario, certify=False)
    laws = [
        csw.evaluate(scenario, "leader", 2e-3, guide=guide, aggregation_tol=spacing).success
        for spacing in (0.0, 1e-10, None, 5e-7)
    ]
    assert max(law.low for law in laws) <= min(law.high for law in laws)
    assert np.ptp([law.low for law in laws]) < 5e-4  # by ties, success differed by 0.002

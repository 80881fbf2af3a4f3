"""Formation problems in lanes: objective, projection, and independence of the other lanes."""

import numba
import numpy as np
import pytest
from formation_cases import HAZARDS, formations
from hypothesis import given, settings
from hypothesis import strategies as st

import casswarm as csw
from casswarm.formation import SpectralProjectedGradient, formation_program, lane_kernels
from casswarm.formation.lane_kernels import Jobs, Limits, Tasks, empty_lanes, solve_jobs
from casswarm.formation.lane_objective_kernels import (
    ALIVE,
    EAST,
    GRADIENT_EAST,
    GRADIENT_NORTH,
    LANES,
    NORTH,
    ROWS,
    WEIGHT,
)
from casswarm.formation.multistart_kernels import CHUNK
from casswarm.formation.objective import CompiledObjective, formation_objective
from casswarm.hazard.zones import Zone
from casswarm.motion.planar import PlanarSets
from casswarm.motion.planar_kernels import nearest_batch

ZONED = csw.Saturation(((4.4, 4.6),), zones=(Zone(((0.5, 0.2),), 1.0, 0.7, 0.4),))


def rates_in_lanes(hazard, n):
    """Python function of the objective in lanes."""
    evaluate = formation_objective(hazard, n, True).kernels[1]
    return numba.njit(lambda *arguments: evaluate(*arguments))  # noqa: PLW0108  (a CFunc)


@pytest.mark.parametrize("differ", [False, True])
@pytest.mark.parametrize("name", [*HAZARDS, "zones"])
@pytest.mark.parametrize("used", [LANES, 3])
def test_objective_in_lanes_equals_casadi(name, differ, used):
    n, rng = 5, np.random.default_rng(1)
    hazard = HAZARDS.get(name, ZONED)
    if differ:
        hazard = hazard.with_members(*(tuple(each) for each in rng.uniform(0.2, 4.0, (2, n))))
    nlp, compiled = formation_program(hazard, n, True), formation_objective(hazard, n, True)
    positions, alive = rng.normal(0.0, 1.0, (used, n, 2)), rng.random((used, n)) < 0.8
    weights = alive * rng.uniform(0.5, 2.0, (used, n)) * (rng.random((used, n)) < 0.8)
    members = np.full((n, ROWS, LANES), np.nan)
    for row, values in (
        (EAST, positions[..., 0]),
        (NORTH, positions[..., 1]),
        (ALIVE, alive),
        (WEIGHT, weights),
    ):
        members[:, row // LANES, :used] = values.T
    f, pairs = np.empty(LANES), np.full(n * n * LANES, np.nan)
    rates_in_lanes(hazard, n)(members.ravel(), np.empty(used), compiled.constants.copy(), f, pairs)
    for k in range(used):
        p = nlp.pack_parameters(
            positions=np.zeros((n, 2)),
            previous_velocities=np.zeros((n, 2)),
            alive=alive[k][:, None],
            weights=weights[k][:, None],
            goal=np.zeros((1, 2)),
            dt=1.0,
            v_max=2.0,
        )
        expected, slope = nlp.gradient(positions[k].ravel(), np.asarray(p, float).ravel())
        assert f[k] == pytest.approx(float(expected), rel=1e-12)
        gradient = members[:, [GRADIENT_EAST // LANES, GRADIENT_NORTH // LANES], k]
        np.testing.assert_allclose(
            gradient.ravel(), np.asarray(slope).ravel(), rtol=1e-10, atol=1e-12
        )


def planar_sets(rng, count):
    """Boxes with discs of all kinds: absent, small, disjoint from the box, and points."""
    center = rng.normal(0.0, 0.6, (count, 2))
    half = rng.choice([0.0, 0.3, 2.0], (count, 1))
    radii = rng.choice([0.2, 0.7, 1.5, np.inf], (count, 3))
    centers = center[:, None] + rng.normal(0.0, 0.5, (count, 3, 2))
    return PlanarSets(center - half, center + half, centers, radii)


def test_projection_in_lanes_is_that_of_one_point():
    rng, resolved, total = np.random.default_rng(0), 0, 0
    for _ in range(300):
        sets = planar_sets(rng, LANES).packed
        points = rng.normal(0.0, rng.choice([0.3, 1.0, 5.0]), (LANES, 2))
        expected, exists = np.empty_like(points), np.empty(LANES, bool)
        nearest_batch(points, sets, expected, exists)
        motion = np.zeros((lane_kernels.MOTION_ROWS, LANES))
        motion[:13] = sets.T
        flat, way = motion.ravel(), lane_kernels.DIRECTION_X // LANES
        for k in range(LANES):
            lane_kernels.write_crossings(flat, k)
            lane_kernels.write_tolerances(flat, k)
        motion[way : way + 2] = points.T
        unresolved = np.zeros(LANES)
        lane_kernels.project_lanes(flat, LANES, unresolved)
        done = unresolved == 0.0
        assert exists[done].all()
        np.testing.assert_allclose(motion[way : way + 2].T[done], expected[done], atol=1e-12)
        np.testing.assert_array_equal(motion[way : way + 2].T[~done], points[~done])
        resolved, total = resolved + np.count_nonzero(done), total + np.count_nonzero(exists)
    assert resolved > 0.6 * total


@pytest.mark.parametrize("name", ["paper-1", "paper-2"])
@pytest.mark.parametrize("count", [1, 2, LANES + 3, CHUNK // 4 + 5])
def test_answer_does_not_depend_on_other_states_of_batch(name, count):
    solver, formation = SpectralProjectedGradient(), formations(name, CHUNK + 40)[1]
    order = np.random.default_rng(2).permutation(CHUNK + 40)[:count]
    together = solver.solve_batch(formation.nlp, formation.instances)
    some = solver.solve_batch(formation.nlp, formation.instances[order])
    np.testing.assert_array_equal(some.x, together.x[order])
    np.testing.assert_array_equal(some.objective, together.objective[order])
    np.testing.assert_array_equal(some.iterations, together.iterations[order])


def coarse_ends(formation, starts):
    """Ends and objectives of tasks, start i of problem i modulo their number."""
    _, evaluate_lanes, shared = formation.nlp.attached(CompiledObjective).kernels
    instances, tasks = formation.instances, len(starts)
    sets = instances.feasible_set.packed
    problem = np.arange(tasks) % len(sets)
    out = Tasks(problem, starts.copy(), np.empty(tasks), np.zeros((tasks, 2), np.int64))
    limits = Limits(1e-6, 0.0, 500)
    jobs = Jobs(instances.p.copy(), sets, instances.scale.copy(), out, tasks, limits)
    solve_jobs(evaluate_lanes, shared.constants, jobs, empty_lanes(starts.shape[1] // 2))
    return out


def test_lane_that_is_not_finite_ends_alone():
    formation = formations("paper-2", 30)[1]
    starts = formation.instances.x0[:30]
    expected, broken = coarse_ends(formation, starts), starts.copy()
    broken[7, 3], broken[21, 0] = np.nan, np.inf
    found, fine = coarse_ends(formation, broken), np.ones(30, bool)
    fine[[7, 21]] = False
    assert np.isfinite(expected.f).all()
    assert not np.isfinite(found.f[~fine]).any()
    np.testing.assert_array_equal(found.x[fine], expected.x[fine])
    np.testing.assert_array_equal(found.counts[fine], expected.counts[fine])


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 70), st.integers(0, 1000))
def test_ends_do_not_depend_on_number_of_tasks(count, seed):
    formation = formations("paper-1", 70)[1]
    starts, rng = formation.instances.x0, np.random.default_rng(seed)
    expected = coarse_ends(formation, starts)
    first = rng.integers(0, 71 - count)
    some = formations("paper-1", 70)[1].instances[first : first + count]
    _, evaluate_lanes, shared = formation.nlp.attached(CompiledObjective).kernels
    out = Tasks(np.arange(count), some.x0.copy(), np.empty(count), np.zeros((count, 2), np.int64))
    jobs = Jobs(
        some.p.copy(),
        some.feasible_set.packed,
        some.scale.copy(),
        out,
        count,
        Limits(1e-6, 0.0, 500),
    )
    solve_jobs(evaluate_lanes, shared.constants, jobs, empty_lanes(5))
    np.testing.assert_array_equal(out.x, expected.x[first : first + count])

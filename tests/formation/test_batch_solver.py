"""The compiled batch solver, and the default solver, which verifies it."""

import pickle
from dataclasses import replace

import casadi as ca
import numba
import numpy as np
import pytest
from formation_cases import HAZARDS, disc
from window_cases import MOTION

import casswarm as csw
from casswarm.errors import SolverError
from casswarm.formation import (
    Auto,
    CompiledObjective,
    SpectralProjectedGradient,
    corridor_formation,
    formation_program,
    leader_formation,
)
from casswarm.formation.multistart_kernels import minimise_batch
from casswarm.formation.objective import formation_objective
from casswarm.formation.spectral_kernels import LARGE_SWARM, invert_blocks, precondition
from casswarm.motion import Step
from casswarm.solvers import Ipopt

GOAL = np.array([3.0, 2.5])
PLAIN, COLLIDING = HAZARDS["plain"], HAZARDS["collision"]


def step(hazard, states=60, n=5, seed=0):
    """States around the goal: positions, velocities, some members destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((states, n)) < 0.8
    alive[:, 0] = True
    towards = rng.uniform(-1.2, 1.2, (states, 1, 2))
    previous_velocities = towards + rng.normal(scale=0.1, size=(states, n, 2))
    positions = GOAL - MOTION.dt * towards + rng.normal(scale=0.2, size=(states, n, 2))
    shown = alive[..., None]
    return Step(hazard, MOTION, shown * positions, shown * previous_velocities, alive, GOAL[None])


def leader(hazard, **options):
    data = step(hazard, **options)
    return leader_formation(data, np.zeros(len(data.alive), np.intp))


def corridor(hazard, **options):
    return corridor_formation(step(hazard, **options), 0.05)


@pytest.mark.parametrize("n", [5, pytest.param(LARGE_SWARM + 1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("differ", [False, True])
@pytest.mark.parametrize("hazard", HAZARDS)
def test_compiled_objective_equals_casadi(hazard, differ, n):
    """With its gradient and, of a large swarm, the diagonal blocks of its Hessian."""
    rng, large, hazard = np.random.default_rng(0), n > 5, HAZARDS[hazard]
    if differ:
        hazard = hazard.with_members(*(tuple(each) for each in rng.uniform(0.2, 4.0, (2, n))))
    nlp = formation_program(hazard, n, False)
    compiled = nlp.attached(CompiledObjective)
    kernel, gradient = called(compiled.evaluate), np.empty((5 if large else 2) * n)
    symbols = ca.MX.sym("x", 2 * n)
    for _ in range(1 if large else 20):
        alive = rng.random(n) < 0.8
        weights = alive * rng.uniform(0.5, 2.0, n) * (rng.random(n) < 0.8)
        p = nlp.pack_parameters(
            positions=rng.normal(0.0, 1.0, (n, 2)),
            previous_velocities=np.zeros((n, 2)),
            alive=alive[:, None],
            weights=weights[:, None],
            goal=np.zeros((1, 2)),
            dt=0.33,
            v_max=2.0,
        )
        p, x = np.asarray(p, float).ravel(), rng.uniform(-2, 2, 2 * n)
        f = kernel(x, p, compiled.constants, gradient, np.empty(n * (n + 8)))
        expected, slope = nlp.gradient(x, p)
        assert f == pytest.approx(float(expected), rel=1e-12)
        np.testing.assert_allclose(
            gradient[: 2 * n], np.asarray(slope).ravel(), rtol=1e-10, atol=1e-12
        )
        if large:
            hessian, _ = ca.hessian(nlp.evaluate(symbols, p)[0], symbols)
            hessian = np.asarray(ca.Function("hessian", [symbols], [hessian])(x))
            blocks = hessian.reshape(n, 2, n, 2)[np.arange(n), :, np.arange(n)]
            blocks = np.where(alive[:, None], blocks[:, [0, 0, 1], [0, 1, 1]], 0.0)
            np.testing.assert_allclose(
                gradient[2 * n :].reshape(n, 3),
                blocks,
                rtol=1e-9,
                atol=1e-12 * np.abs(blocks).max(),
            )


def called(evaluate):
    """Python function that calls a compiled objective, as kernels do."""
    return numba.njit(lambda *arguments: evaluate(*arguments))  # noqa: PLW0108  (a CFunc)


def test_hazards_of_one_class_share_compiled_code():
    other = csw.Saturation(((0.0, 1.0),), alpha_1=9.0, alpha_2=1.0, alpha_3=2.0)
    first, second = (formation_objective(h, 5, True) for h in (PLAIN, other))
    assert first.evaluate is second.evaluate
    assert not np.array_equal(first.constants, second.constants)


def test_second_kind_of_hazard_does_not_compile_the_solver_again():
    for hazard in HAZARDS.values():
        formation = leader(hazard, states=2)
        SpectralProjectedGradient().solve_batch(formation.nlp, formation.instances)
    assert len(minimise_batch.entry.signatures) == 1


def test_compiled_objective_pickles():
    formation = corridor(COLLIDING, states=3)
    nlp, instances = pickle.loads(pickle.dumps((formation.nlp, formation.instances)))
    solver = SpectralProjectedGradient()
    expected = solver.solve_batch(formation.nlp, formation.instances)
    np.testing.assert_array_equal(solver.solve_batch(nlp, instances).x, expected.x)
    assert len(minimise_batch.entry.signatures) == 1


@pytest.mark.parametrize("problem", [leader, corridor])
@pytest.mark.parametrize("hazard", ["plain", "strengths"])
def test_spectral_answers_are_no_worse_than_ipopt(problem, hazard):
    formation = problem(HAZARDS[hazard])
    found = SpectralProjectedGradient().solve_batch(formation.nlp, formation.instances)
    judged = Ipopt().solve_batch(formation.nlp, formation.instances)
    assert found.success.mean() > 0.95
    assert found.violation.max() < 1e-9
    assert found.stationarity[found.success].max() <= 1e-7
    worse = found.objective > judged.objective + 1e-6 * np.abs(judged.objective)
    assert not worse[found.success].any()


def test_several_starts_with_collisions_find_better_minima():
    formation = corridor(COLLIDING, states=200)
    one, many = (
        SpectralProjectedGradient(n_starts=starts).solve_batch(formation.nlp, formation.instances)
        for starts in (1, 8)
    )
    both = one.success & many.success
    assert both.mean() >= 0.98
    better = (many.objective < one.objective * (1 - 1e-3))[both]
    worse = (many.objective > one.objective * (1 + 1e-9) + 1e-12)[both]
    assert better.mean() > 0.2
    assert worse.mean() <= 0.01  # starts are compared coarsely, so a few are chosen wrongly


def test_stationarity_equals_that_of_casadi_gradient():
    formation = corridor(COLLIDING, states=20)
    found = SpectralProjectedGradient(max_iter=3).solve_batch(formation.nlp, formation.instances)
    sets = formation.instances.feasible_set
    for i, x in enumerate(found.x):
        gradient = np.asarray(formation.nlp.gradient(x, formation.instances.p[i])[1])
        length, value = formation.instances.scale[i]
        moved = (x - length**2 / value * gradient.ravel()).reshape(-1, 2)
        change = np.abs(sets[i].project(moved).ravel() - x).max() / length
        assert found.stationarity[i] == pytest.approx(change, rel=1e-9, abs=1e-12)


def test_solve_and_solve_batch_agree():
    formation = leader(COLLIDING, states=10)
    solver = SpectralProjectedGradient()
    batch = solver.solve_batch(formation.nlp, formation.instances)
    for i, solution in enumerate(solver.solve(formation.nlp, formation.instances)):
        np.testing.assert_array_equal(solution.x, batch.x[i])
        assert solution.objective == pytest.approx(batch.objective[i], rel=1e-12)
        assert solution.residuals.stationarity < 1e-5


def test_iteration_limit_is_not_a_success():
    formation = corridor(COLLIDING)
    solver = SpectralProjectedGradient(max_iter=1, n_starts=1)
    found = solver.solve_batch(formation.nlp, formation.instances)
    assert not found.success.all()
    statuses = {str(s.status) for s in solver.solve(formation.nlp, formation.instances)}
    assert "iteration limit" in statuses


def test_auto_falls_back_to_ipopt_and_counts_it():
    formation = corridor(COLLIDING)
    hasty = Auto(batch=SpectralProjectedGradient(max_iter=1, n_starts=1))
    found = hasty.solve_batch(formation.nlp, formation.instances)
    assert found.used_fallback.sum() > 10
    assert found.success.all()
    assert found.stationarity.max() < 1e-5
    patient = Auto().solve_batch(formation.nlp, formation.instances)
    assert patient.used_fallback.sum() < found.used_fallback.sum()
    assert patient.success.all()


def test_auto_rejects_answers_that_are_not_finite():
    formation = leader(PLAIN, states=4)
    parameters = formation.instances.p.copy()
    parameters[1, 0] = np.nan  # a position
    found = Auto().solve_batch(formation.nlp, replace(formation.instances, p=parameters))
    assert found.success.tolist() == [True, False, True, True]
    assert found.used_fallback.tolist() == [False, True, False, False]


def rate(positions, alive):
    return 1 / (1 + ca.sum2(positions**2)) + 0 * alive


@pytest.mark.parametrize("problem", [leader, corridor])
def test_auto_without_kernels_uses_ipopt(problem):
    formation = problem(csw.CustomHazard(rate), states=5)
    assert formation.nlp.attached(CompiledObjective) is None
    auto = Auto().solve_batch(formation.nlp, formation.instances)
    ipopt = Ipopt().solve_batch(formation.nlp, formation.instances)
    assert auto.success.all()
    np.testing.assert_array_equal(auto.x, ipopt.x)


def test_spectral_without_kernels_or_feasible_set_is_refused():
    custom, plain = leader(csw.CustomHazard(rate), states=2), leader(PLAIN, states=3)
    with pytest.raises(SolverError, match="objective made of kernels"):
        SpectralProjectedGradient().solve(custom.nlp, custom.instances)
    unset = replace(plain.instances, feasible_set=None)
    with pytest.raises(SolverError, match="boxes and discs"):
        SpectralProjectedGradient().solve(plain.nlp, unset)


@pytest.mark.parametrize("options", [{"tolerance": 0.0}, {"max_iter": 0}, {"n_starts": 0}])
def test_spectral_option_out_of_range_is_refused(options):
    with pytest.raises(SolverError, match=next(iter(options))):
        SpectralProjectedGradient(**options)


@pytest.mark.parametrize("solver", [Auto(), Ipopt(), SpectralProjectedGradient()])
def test_empty_batch_has_no_answers(solver):
    formation = leader(PLAIN, states=2)
    found = solver.solve_batch(formation.nlp, formation.instances[slice(0, 0)])
    assert len(found.success) == len(found.x) == 0


# --- large swarms


def solved(n, seed=0, area=0.01, solver=None):
    formation = corridor_formation(disc(n, seed, area), area * n)
    solver = solver or SpectralProjectedGradient(1e-10)
    found = solver.solve_batch(formation.nlp, formation.instances)
    assert found.success.all()
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("hazard", "members"), [("plain", 1000), ("collision", 100)])
def test_spectral_protects_the_leader_of_large_swarms(hazard, members):
    """With collisions all pairs of members count."""
    formation = leader_formation(disc(members, area=0.02, hazard=hazard), np.zeros(1, np.intp))
    found = SpectralProjectedGradient(n_starts=1).solve_batch(formation.nlp, formation.instances)
    assert found.success.all()


@pytest.mark.parametrize(
    ("n", "seed", "area"),
    [
        *((50, seed, area) for seed in range(3) for area in (0.01, 0.075)),
        pytest.param(200, 0, 0.01, marks=pytest.mark.slow),
    ],
)
def test_objective_of_large_swarm_is_no_worse_than_ipopts(n, seed, area):
    found, expected = solved(n, seed, area), solved(n, seed, area, Ipopt(tolerance=1e-12))
    assert found.objective[0] <= (1 + 1e-6) * expected.objective[0]
    if area == 0.01:  # wide corridors have several minima
        assert found.objective == pytest.approx(expected.objective, rel=1e-6)


@pytest.mark.parametrize("n", [50, 200, pytest.param(1000, marks=pytest.mark.slow)])
def test_large_swarms_are_stationary_and_feasible(n):
    found = solved(n, solver=Auto())
    assert not found.used_fallback.any()
    assert found.stationarity.max() <= 1e-6
    assert found.violation.max() <= 1e-9


def test_preconditioner_inverts_the_magnitudes_of_curvatures_on_the_face():
    free, tangent = np.array([[3.0, 1.0], [1.0, -2.0]]), np.array([0.6, 0.8])
    blocks = np.array([3.0, 1.0, -2.0, 1.0, 0.5, 4.0, 1.0, 0.0, 1.0])
    face = np.array([[2.0, 0.0, 0.0, 0.0], [1.0, *tangent, 2.0], [0.0, 0.0, 0.0, 0.0]])
    vector, out = np.array([1.0, 2.0, 3.0, -1.0, 5.0, 6.0]), np.empty(6)
    inverse = blocks.copy()
    invert_blocks(inverse, face)
    product = precondition(vector, inverse, out)
    values, axes = np.linalg.eigh(free)
    expected = (axes / np.abs(values)) @ axes.T @ vector[:2]
    np.testing.assert_allclose(out[:2], expected, rtol=1e-12)
    along = tangent @ np.array([[1.0, 0.5], [0.5, 4.0]]) @ tangent + 2.0
    np.testing.assert_allclose(out[2:4], (tangent @ vector[2:4]) / along * tangent, rtol=1e-12)
    np.testing.assert_array_equal(out[4:], 0.0)
    assert product == pytest.approx(vector @ out, rel=1e-12)


@pytest.mark.parametrize("n", [5, 20])
def test_scale_is_the_rate_of_isolated_members(n):
    data = disc(n)
    scale = corridor_formation(data, 0.01 * n).instances.scale
    expected = PLAIN.single_agent_rates(data.positions).sum(axis=1)
    np.testing.assert_allclose(scale, [[MOTION.v_max, expected[0]]], rtol=1e-13)

"""The compiled batch solver, and the default solver, which verifies it."""

import pickle
from dataclasses import dataclass, replace

import casadi as ca
import numba
import numpy as np
import pytest

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
from casswarm.formation.objective import formation_objective
from casswarm.formation.search_kernels import minimise_batch
from casswarm.hazard import KernelHazard, regular
from casswarm.motion import Motion, Step
from casswarm.solvers import Ipopt

MOTION = Motion(v_max=2.0, a_max=0.5, dt=0.33)
RADARS = ((4.4, 4.6), (4.5, 3.0))
GOAL = np.array([3.0, 2.5])


@dataclass(frozen=True)
class Gaussian(KernelHazard):
    """A user's kernels: bell-shaped sources, and a crowd that multiplies."""

    height: float = 2.0

    def source(self, squared_distance):
        return self.height * ca.exp(-0.3 * squared_distance)

    def density(self, squared_distance):
        return ca.exp(-squared_distance)

    def collision(self, squared_distance):
        return 1e-3 / regular(squared_distance)

    def combine(self, source, density, collision):
        return source * ca.exp(-0.5 * density) + collision


HAZARDS = [
    csw.Saturation(RADARS, alpha_1=4.0, alpha_2=3.0, alpha_3=4.0),
    csw.Saturation(RADARS, (0.5, 2.0), alpha_1=1.0, alpha_2=0.0, alpha_3=2.0),
    csw.SaturationCollision(RADARS, beta_1=0.2, beta_2=6.0),
    Gaussian(RADARS),
]


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


@pytest.mark.parametrize("hazard", HAZARDS, ids=["plain", "strengths", "collision", "gaussian"])
def test_compiled_objective_equals_casadi(hazard):
    nlp = formation_program(hazard, 5, False)
    formation = leader(hazard)
    compiled = nlp.attached(CompiledObjective)
    gradient, kernel = np.empty(10), called(compiled.evaluate)
    for p in formation.instances.p[:20]:
        x = np.random.default_rng(1).uniform(-2, 2, 10)
        f = kernel(x, p.copy(), compiled.constants, gradient, np.empty(65))
        expected, slope = nlp.gradient(x, p)
        assert f == pytest.approx(float(expected), rel=1e-12)
        np.testing.assert_allclose(gradient, np.asarray(slope).ravel(), rtol=1e-10, atol=1e-12)


def called(evaluate):
    """Python function that calls a compiled objective, as kernels do."""
    return numba.njit(lambda *arguments: evaluate(*arguments))  # noqa: PLW0108  (a CFunc)


def test_hazards_of_one_class_share_compiled_code():
    other = csw.Saturation(((0.0, 1.0),), alpha_1=9.0, alpha_2=1.0, alpha_3=2.0)
    first, second = (formation_objective(h, 5) for h in (HAZARDS[0], other))
    assert first.evaluate is second.evaluate
    assert not np.array_equal(first.constants, second.constants)


def test_second_kind_of_hazard_does_not_compile_the_solver_again():
    for hazard in HAZARDS:
        formation = leader(hazard, states=2)
        SpectralProjectedGradient().solve_batch(formation.nlp, formation.instances)
    assert len(minimise_batch.entry.signatures) == 1


def test_compiled_objective_pickles():
    formation = corridor(HAZARDS[2], states=3)
    nlp, instances = pickle.loads(pickle.dumps((formation.nlp, formation.instances)))
    solver = SpectralProjectedGradient()
    expected = solver.solve_batch(formation.nlp, formation.instances)
    np.testing.assert_array_equal(solver.solve_batch(nlp, instances).x, expected.x)
    assert len(minimise_batch.entry.signatures) == 1


@pytest.mark.parametrize("problem", [leader, corridor])
@pytest.mark.parametrize("hazard", HAZARDS[:2], ids=["plain", "strengths"])
def test_spectral_answers_are_no_worse_than_ipopt(problem, hazard):
    formation = problem(hazard)
    found = SpectralProjectedGradient().solve_batch(formation.nlp, formation.instances)
    judged = Ipopt().solve_batch(formation.nlp, formation.instances)
    assert found.success.mean() > 0.95
    assert found.violation.max() < 1e-9
    assert found.stationarity[found.success].max() <= 1e-7
    worse = found.objective > judged.objective + 1e-6 * np.abs(judged.objective)
    assert not worse[found.success].any()


def test_several_starts_with_collisions_find_better_minima():
    formation = corridor(HAZARDS[2], states=200)
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
    formation = corridor(HAZARDS[2], states=20)
    found = SpectralProjectedGradient(max_iter=3).solve_batch(formation.nlp, formation.instances)
    sets = formation.instances.feasible_set
    for i, x in enumerate(found.x):
        gradient = np.asarray(formation.nlp.gradient(x, formation.instances.p[i])[1])
        length, value = formation.instances.scale[i]
        moved = (x - length**2 / value * gradient.ravel()).reshape(-1, 2)
        change = np.abs(sets[i].project(moved).ravel() - x).max() / length
        assert found.stationarity[i] == pytest.approx(change, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("solver", [SpectralProjectedGradient(), Auto()], ids=lambda s: s.name)
def test_answer_is_independent_of_batch(solver):
    formation = corridor(HAZARDS[2], states=700)  # enough for two threads
    instances = formation.instances
    together = solver.solve_batch(formation.nlp, instances).x
    order = np.random.default_rng(0).permutation(len(instances))
    shuffled = solver.solve_batch(formation.nlp, instances[order]).x
    np.testing.assert_array_equal(shuffled, together[order])
    for i in (0, 13, 699):
        alone = solver.solve_batch(formation.nlp, instances[slice(i, i + 1)]).x
        np.testing.assert_array_equal(alone[0], together[i])


def test_solve_and_solve_batch_agree():
    formation = leader(HAZARDS[2], states=10)
    solver = SpectralProjectedGradient()
    batch = solver.solve_batch(formation.nlp, formation.instances)
    for i, solution in enumerate(solver.solve(formation.nlp, formation.instances)):
        np.testing.assert_array_equal(solution.x, batch.x[i])
        assert solution.objective == pytest.approx(batch.objective[i], rel=1e-12)
        assert solution.residuals.stationarity < 1e-5


def test_iteration_limit_is_not_a_success():
    formation = corridor(HAZARDS[2])
    solver = SpectralProjectedGradient(max_iter=1, n_starts=1)
    found = solver.solve_batch(formation.nlp, formation.instances)
    assert not found.success.all()
    statuses = {str(s.status) for s in solver.solve(formation.nlp, formation.instances)}
    assert "iteration limit" in statuses


def test_auto_falls_back_to_ipopt_and_counts_it():
    formation = corridor(HAZARDS[2])
    hasty = Auto(batch=SpectralProjectedGradient(max_iter=1, n_starts=1))
    found = hasty.solve_batch(formation.nlp, formation.instances)
    assert found.used_fallback.sum() > 10
    assert found.success.all()
    assert found.stationarity.max() < 1e-5
    patient = Auto().solve_batch(formation.nlp, formation.instances)
    assert patient.used_fallback.sum() < found.used_fallback.sum()
    assert patient.success.all()


def test_auto_rejects_answers_that_are_not_finite():
    formation = leader(HAZARDS[0], states=4)
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


def test_spectral_without_kernels_is_refused():
    formation = leader(csw.CustomHazard(rate), states=2)
    with pytest.raises(SolverError, match="objective made of kernels"):
        SpectralProjectedGradient().solve(formation.nlp, formation.instances)


def test_spectral_without_feasible_set_is_refused():
    formation = leader(HAZARDS[0], states=3)
    with pytest.raises(SolverError, match="boxes and discs"):
        SpectralProjectedGradient().solve(
            formation.nlp, replace(formation.instances, feasible_set=None)
        )


@pytest.mark.parametrize("options", [{"tolerance": 0.0}, {"max_iter": 0}, {"n_starts": 0}])
def test_spectral_option_out_of_range_is_refused(options):
    with pytest.raises(SolverError, match=next(iter(options))):
        SpectralProjectedGradient(**options)


@pytest.mark.parametrize(("collision", "members"), [(False, 1000), (True, 100)])
def test_spectral_solves_large_swarms(collision, members):
    """With collisions all pairs of members count."""
    rng = np.random.default_rng(0)
    hazard = HAZARDS[2] if collision else HAZARDS[0]
    positions = rng.uniform(-6, 0, (1, members, 2))
    alive = np.ones((1, members), bool)
    data = Step(hazard, MOTION, positions, np.ones((1, members, 2)), alive, GOAL[None])
    formation = leader_formation(data, np.zeros(1, np.intp))
    found = SpectralProjectedGradient(n_starts=1).solve_batch(formation.nlp, formation.instances)
    assert found.success.all()


@pytest.mark.parametrize("solver", [Auto(), Ipopt(), SpectralProjectedGradient()])
def test_empty_batch_has_no_answers(solver):
    formation = leader(HAZARDS[0], states=2)
    found = solver.solve_batch(formation.nlp, formation.instances[slice(0, 0)])
    assert len(found.success) == len(found.x) == 0


@pytest.mark.parametrize("length", [1e-2, 1e4])
@pytest.mark.parametrize("risk", [1e-6, 1e3])
@pytest.mark.parametrize("problem", [leader, corridor])
def test_answers_are_independent_of_units(problem, length, risk):
    """Lengths in other units, and rates in other units of time, give the same velocities."""
    one = problem(HAZARDS[0])
    hazard = csw.Saturation(
        tuple((length * x, length * y) for x, y in RADARS),
        alpha_1=4.0 * risk * length**2,
        alpha_2=3.0,
        alpha_3=4.0 / length**2,
    )
    data = step(HAZARDS[0])
    scaled = Step(
        hazard,
        Motion(2.0 * length, 0.5 * length**2, MOTION.dt),
        length * data.positions,
        length * data.previous_velocities,
        data.alive,
        length * GOAL[None],
    )
    other = (
        leader_formation(scaled, np.zeros(len(data.alive), np.intp))
        if problem is leader
        else corridor_formation(scaled, 0.05 * length**2)
    )
    np.testing.assert_array_equal(other.infeasible, one.infeasible)
    answers = [Auto().solve_batch(f.nlp, f.instances) for f in (one, other)]
    assert answers[1].success.all()
    np.testing.assert_allclose(
        answers[1].objective, risk * answers[0].objective, rtol=1e-6, atol=0.0
    )

"""The paper's projected gradient: closed forms, Ipopt's answers, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from formation_cases import formations
from hock_schittkowski import published
from known_problems import nearest_in_box, planar

from casswarm.errors import SolverError
from casswarm.formation import ProjectedGradient
from casswarm.nlp import Nlp, Status
from casswarm.solvers import Ipopt

# --- closed forms


def to_point(*goal: float) -> Any:
    """Squared distance to a point."""
    return lambda x: ca.sumsqr(x - ca.DM(goal))


CLOSED_FORMS = {  # objective, start, half widths of the box, discs, answer, objective there
    "circle": (to_point(5, 0), [[0, 0]], [[4, 2.2]], [[0, 0, 3]], [3, 0], 4),
    "inside": (to_point(0.5, -0.5), [[0, 0]], [[4, 2.2]], [[0, 0, 3]], [0.5, -0.5], 0),
    "edge on circle": (to_point(3, 4), [[0, 0]], [[4, 2.2]], [[0, 0, 3]], [4.16**0.5, 2.2], None),
    "box": (to_point(0, 7), [[0, 0]], [[4, 2.2]], [[0, 0, 3]], [0, 2.2], 4.8**2),
    "linear": (lambda x: 3 * x[0] - 4 * x[1], [[0, 0]], [[50, 50]], [[1, 2, 5]], [-2, 6], -30),
    "between discs": (
        lambda x: ca.sumsqr(x[:, 0] - x[:, 1]),
        [[1, -9], [7, 7]],
        [[50, 50], [50, 50]],
        [[0, 0, 1], [3, 4, 2]],
        [0.6, 0.8, 1.8, 2.4],
        (5 - 3) ** 2,
    ),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_projected_gradient_finds_closed_form(name: str) -> None:
    objective, *numbers, nearest, value = CLOSED_FORMS[name]
    start, box, discs = (np.array(each, float) for each in numbers)
    solution = ProjectedGradient().solve(*planar(objective, start, -box, box, discs))[0]
    assert solution.status is Status.SOLVED
    np.testing.assert_allclose(solution.x, nearest, atol=1e-6)
    assert value is None or solution.objective == pytest.approx(value, abs=1e-9)
    assert solution.residuals.stationarity < 1e-5
    assert solution.residuals.violation < 1e-12


# --- the algorithm


def by_hand(x: np.ndarray, goal: np.ndarray, step: float, iterations: int) -> np.ndarray:
    for _ in range(iterations):
        x = np.clip(x - step * 2 * (x - goal), -1, 1)
    return x


@pytest.mark.parametrize("iterations", [0, 1, 2, 7])
def test_projected_gradient_iterates_equal_those_of_paper(iterations: int) -> None:
    goals = np.array([[0.5, -0.2], [3.0, 0.1]])
    nlp, instances = nearest_in_box(goals)
    solver = ProjectedGradient(step=0.1, max_iter=iterations, tolerance=0)
    solutions = solver.solve(nlp, instances)
    expected = by_hand(np.zeros((2, 2)), goals, 0.1, iterations)
    np.testing.assert_allclose([s.x for s in solutions], expected, rtol=1e-14)
    for solution in solutions:
        assert solution.status is Status.ITERATION_LIMIT
        assert solution.message == "iterations exhausted"
        assert solution.iterations == iterations


def test_projected_gradient_steps_in_scaled_variables() -> None:
    """Steps in x / x_scale are those of the same problem stated in x / x_scale."""
    goal, scale = np.array([[0.5, -0.2]]), 1 / 0.33
    nlp, instances = nearest_in_box(goal)
    solver = ProjectedGradient(step=0.01, x_scale=scale, max_iter=9, tolerance=0)
    u = np.zeros((1, 2))
    for _ in range(9):
        u = np.clip(u - 0.01 * 2 * scale * (scale * u - goal), -1 / scale, 1 / scale)
    np.testing.assert_allclose(solver.solve(nlp, instances)[0].x, scale * u[0], rtol=1e-12)


@pytest.mark.parametrize("scale", [0.5, 1.0, 4.0])
def test_projected_gradient_tolerance_is_of_scaled_steps(scale: float) -> None:
    """It stops where the gradient by x / x_scale, with its projection, is below the tolerance."""
    nlp, instances = nearest_in_box(np.array([[0.5, 0.5]]))
    solver = ProjectedGradient(step=0.1 / scale**2, x_scale=scale, tolerance=1e-4)
    error = np.abs(solver.solve(nlp, instances)[0].x - 0.5).max()
    assert 0.64e-4 / scale < 2 * error <= 0.8e-4 / scale  # an iteration takes a fifth of it


def test_projected_gradient_projects_infeasible_x0() -> None:
    nlp, instances = nearest_in_box(np.zeros((1, 2)))
    outside = instances.with_x0(np.array([[9.0, -9.0]]))
    solution = ProjectedGradient(step=0.1, max_iter=1).solve(nlp, outside)[0]
    np.testing.assert_allclose(solution.x, [0.8, -0.8])


def test_projected_gradient_start_zero_is_projected() -> None:
    nlp, instances = nearest_in_box(np.ones((1, 2)))
    shifted = replace(instances.with_x0(np.ones((1, 2))), lbx=np.array([[0.25, -1.0]]))
    for start, expected in (("x0", [1, 1]), ("zero", [0.25, 0])):
        solver = ProjectedGradient(max_iter=0, start=start)  # type: ignore[arg-type]
        assert solver.solve(nlp, shifted)[0].x.tolist() == expected


def test_projected_gradient_stops_at_small_steps() -> None:
    goals = np.array([[0.0, 0.0], [0.5, 0.5]])  # the first starts at its solution
    first, second = ProjectedGradient(step=0.25).solve(*nearest_in_box(goals))
    assert first.iterations == 1
    assert first.x.tolist() == [0, 0]
    assert 10 < second.iterations < 40  # the error halves; 1e-6 is reached in twenty
    assert np.abs(second.x - 0.5).max() <= 1e-6
    assert second.status is first.status is Status.SOLVED


@pytest.mark.parametrize("chunk", [1, 2, 256])
def test_projected_gradient_instances_are_independent(
    chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    nlp, instances = nearest_in_box(np.random.default_rng(3).uniform(-2, 2, (9, 2)))
    solver = ProjectedGradient()
    alone = [solver.solve(nlp, instances[i : i + 1])[0] for i in range(9)]
    monkeypatch.setattr("casswarm.formation.projected_gradient._CHUNK", chunk)
    for one, other in zip(alone, solver.solve(nlp, instances), strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        assert (one.iterations, one.status) == (other.iterations, other.status)


def zigzag(keep: Any) -> Any:
    """A kink at 0.3 that a fixed step of 0.5 jumps over, from either side."""
    nlp, instances = nearest_in_box(np.zeros((1, 2)))
    kink = replace(nlp, objective=ca.fabs(nlp.x[0] - 0.3) + nlp.x[0] ** 2 / 4)
    return ProjectedGradient(step=0.5, max_iter=8, keep=keep).solve(kink, instances)[0]


def test_projected_gradient_keeps_best_iterate() -> None:
    last, best = zigzag("last"), zigzag("best")
    assert best.objective < last.objective
    assert best.status is last.status is Status.ITERATION_LIMIT
    x, seen = 0.0, []
    for _ in range(8):
        seen.append(abs(x - 0.3) + x**2 / 4)
        x = np.clip(x - 0.5 * (np.sign(x - 0.3) + x / 2), -1, 1)
    assert best.objective == pytest.approx(min(seen))


@pytest.mark.parametrize("keep", ["last", "best"])
def test_projected_gradient_non_finite_gradient_fails(keep: Any) -> None:
    nlp, instances = nearest_in_box(np.zeros((1, 2)))
    root = replace(nlp, objective=ca.norm_2(nlp.x))  # no slope at zero, where it starts
    solution = ProjectedGradient(keep=keep).solve(root, instances)[0]
    assert solution.status is Status.FAILED
    reason = "; the derivative of the objective with respect to x[0] is nan at the initial guess"
    assert solution.message == "gradient not finite" + reason * (keep == "best")  # else x is nan
    assert solution.iterations == 1


# --- what it refuses


def test_projected_gradient_rejects_general_constraints() -> None:
    case = published(35)
    with pytest.raises(SolverError) as caught:
        ProjectedGradient().solve(case.nlp, case.instance)
    assert str(caught.value) == (
        "projected-gradient cannot solve HS 35: its constraints (budget) are not a product of "
        "boxes and discs"
    )


def test_projected_gradient_accepts_box_only() -> None:
    x = ca.MX.sym("x", 3)  # no points in the plane
    nlp = Nlp("sphere", {"x": x}, {}, ca.sumsqr(x - 1), {})
    case = published(35)
    none = np.empty((1, 0))
    instance = replace(case.instance, lbg=none, ubg=none)
    np.testing.assert_allclose(ProjectedGradient().solve(nlp, instance)[0].x, 1, atol=1e-6)


# --- formations


@pytest.mark.parametrize("which", [0, 1], ids=["leader", "corridor"])
def test_projected_gradient_formations_equal_those_of_ipopt(which: int) -> None:
    formation = formations("paper-1", 8)[which]
    patient = ProjectedGradient(step=1.0, max_iter=20000)  # the paper's 0.05 takes 20000 too
    mine = patient.solve(formation.nlp, formation.instances)
    theirs = Ipopt().solve(formation.nlp, formation.instances)
    for one, other in zip(mine, theirs, strict=True):
        assert one.status is other.status is Status.SOLVED
        assert one.objective == pytest.approx(other.objective, abs=1e-7)
        np.testing.assert_allclose(one.x, other.x, atol=1e-3)  # the valleys are flat
        assert one.residuals.violation < 1e-12
        assert one.residuals.stationarity < 1e-5


@pytest.mark.parametrize("start", ["x0", "zero"])
@pytest.mark.parametrize("which", [0, 1], ids=["leader", "corridor"])
def test_projected_gradient_compiled_iterates_equal_interpreted(which: int, start: Any) -> None:
    formation = formations("paper-1", 8)[which]
    interpreted = replace(formation.nlp, attachments=())
    solver = ProjectedGradient(step=0.05, x_scale=3.0, max_iter=300, start=start)
    compiled = solver.solve_batch(formation.nlp, formation.instances)
    expected = solver.solve_batch(interpreted, formation.instances)
    np.testing.assert_allclose(compiled.x, expected.x, atol=1e-10)
    np.testing.assert_allclose(compiled.objective, expected.objective, rtol=1e-10)
    assert compiled.success.tolist() == expected.success.tolist()
    assert compiled.violation.max() < 1e-12


def test_projected_gradient_compiled_non_finite_gradient_fails() -> None:
    formation = formations("paper-1", 3)[0]
    parameters = formation.instances.p.copy()
    parameters[1, 0] = np.nan  # the position of a member
    broken = replace(formation.instances, p=parameters)
    first, second, third = ProjectedGradient().solve(formation.nlp, broken)
    assert second.status is Status.FAILED
    assert np.isnan(second.x).all()
    assert np.isfinite([first.x, third.x]).all()


@pytest.mark.parametrize("name", ["paper-1", "paper-2"])
def test_projected_gradient_paper_step_keeps_formations_feasible(name: str) -> None:
    for formation in formations(name, 4):
        nlp, instances = formation.nlp, formation.instances
        solver = ProjectedGradient(step=0.05, max_iter=100, keep="best")
        for i, solution in enumerate(solver.solve(nlp, instances)):
            start = float(nlp.evaluate(instances.x0[i], instances.p[i])[0])
            assert solution.objective <= start
            assert solution.residuals.violation < 1e-12
            assert np.isfinite(solution.x).all()
            still = np.repeat(~formation.free[i], 2)
            np.testing.assert_array_equal(solution.x[still], instances.lbx[i, still])

"""Perturbed copies have the optima, multipliers and residuals of the original."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hock_schittkowski import KNOWN, published
from hypothesis import given, settings
from hypothesis import strategies as st
from known_problems import nearest_in_box, planar

from casswarm.comparison import Problem
from casswarm.comparison.perturbation import ProblemCopy, Reformulation, problem_copies
from casswarm.nlp import Instances, Status, kkt_residuals
from casswarm.solvers import Answer, Ipopt


def problem(number: int) -> Problem:
    case = KNOWN[number]
    return Problem(case.nlp.name, "known", case.nlp, {"cold": case.instance})


def copies_of(posed: Problem, copies: int = 1, seed: int = 0) -> list[ProblemCopy]:
    return list(problem_copies([posed], copies, seed))


def answer(x, multipliers=None) -> Answer:
    return Answer(x, Status.SOLVED, "", 0, 0, 0.0, multipliers)


@given(st.integers(0, len(KNOWN) - 1), st.integers(0, 2**64 - 1))
@settings(max_examples=50)
def test_copy_has_the_functions_of_the_original(number: int, seed: int) -> None:
    case, (_, copy) = KNOWN[number], copies_of(problem(number), 1, seed)
    start, change = copy.starts["cold"], copy.reformulation
    x = copy.restored(answer(start.x0[0])).x
    objective, g = (np.asarray(v).ravel() for v in case.nlp.evaluate(x, []))
    new_objective, new_g = (np.asarray(v).ravel() for v in copy.nlp.evaluate(start.x0[0], []))
    np.testing.assert_allclose(new_objective, change.f_scale * objective, rtol=1e-12)
    np.testing.assert_allclose(new_g, (change.g_scale * g)[change.constraints], rtol=1e-12)
    for name in ("lbx", "ubx"):
        bound = getattr(start, name)[0] * change.x_scale[change.variables]
        np.testing.assert_array_equal(bound, getattr(case.instance, name)[0][change.variables])


@given(st.integers(0, len(KNOWN) - 1), st.integers(0, 2**64 - 1))
@settings(max_examples=50)
def test_optimum_of_the_original_is_optimum_of_the_copy(number: int, seed: int) -> None:
    case, (_, copy) = KNOWN[number], copies_of(problem(number), 1, seed)
    change = copy.reformulation
    y = (case.x / change.x_scale)[change.variables]
    bounds = (case.bound_multipliers * change.x_scale)[change.variables] * change.f_scale
    rows = (case.row_multipliers / change.g_scale)[change.constraints] * change.f_scale
    residuals = kkt_residuals(copy.nlp, copy.starts["cold"], y, (bounds, rows))
    assert max(residuals.violation, residuals.stationarity, residuals.complementarity) < 1e-5
    restored = copy.restored(answer(y, (bounds, rows)))
    np.testing.assert_allclose(restored.x, case.x, rtol=1e-15)
    np.testing.assert_allclose(restored.multipliers[0], case.bound_multipliers, atol=1e-15)
    np.testing.assert_allclose(restored.multipliers[1], case.row_multipliers, atol=1e-15)


@pytest.mark.parametrize("number", [15, 35, 43, 71, 76, 100])
def test_solver_finds_the_same_optimum_of_copies(number: int) -> None:
    case = published(number)
    posed = Problem("p", "f", case.nlp, {"cold": case.instance})
    for copy in copies_of(posed, 3):
        found = Ipopt().timed_answers(copy.nlp, copy.starts["cold"])[1][0]
        solution = Ipopt().verified(case.nlp, case.instance, copy.restored(found))
        assert solution.status.success
        assert solution.objective == pytest.approx(case.objective, abs=1e-4, rel=1e-4)
        assert solution.residuals.stationarity < 1e-4


def test_copies_depend_on_seed_number_and_name_only() -> None:
    first, second = problem(5), problem(6)
    together = list(problem_copies([first, second], 2, 7))
    assert [copy.number for copy in together] == [0, 1, 2, 0, 1, 2]
    alone = copies_of(second, 1, 7)[1]
    np.testing.assert_array_equal(alone.starts["cold"].x0, together[4].starts["cold"].x0)
    starts = [copy.starts["cold"].x0 for copy in (*together[3:], copies_of(second, 1, 8)[1])]
    assert len({start.tobytes() for start in starts}) == 4


def test_original_comes_first_unchanged() -> None:
    posed = problem(0)
    (original,) = copies_of(posed, 0)
    assert (original.nlp, original.starts) == (posed.nlp, posed.starts)
    given_answer = answer(np.zeros(2))
    assert original.restored(given_answer) is given_answer


def test_copy_starts_within_bounds() -> None:
    posed = problem(5)  # starts at 0.5 in [0, inf)
    at_bound = posed.starts["cold"].with_x0(np.zeros((1, 3)))
    for copy in copies_of(Problem("p", "f", posed.nlp, {"cold": at_bound}), 20)[1:]:
        start = copy.starts["cold"]
        assert ((start.lbx <= start.x0) & (start.x0 <= start.ubx)).all()


def test_copy_of_structured_problem_keeps_its_form() -> None:
    discs = np.array([[0.0, 0, 1], [1.0, 0, 2]])
    nlp, instance = planar(
        lambda x: (x**2)[0], np.zeros((2, 2)), np.full((2, 2), -1.0), np.ones((2, 2)), discs
    )
    copy = copies_of(Problem("p", "f", nlp, {"cold": instance}))[1]
    assert copy.nlp is nlp
    assert copy.reformulation is None
    assert copy.starts["cold"].feasible_set is instance.feasible_set
    assert not np.array_equal(copy.starts["cold"].x0, instance.x0)


def test_restored_answer_of_wrong_size_is_unchanged() -> None:
    change = Reformulation.random(KNOWN[5].nlp, np.random.default_rng(0))
    wrong = answer(np.zeros(7))
    assert change.restored(wrong) is wrong


def test_instances_scale_follows_the_objective() -> None:
    case = KNOWN[5]
    change = Reformulation.random(case.nlp, np.random.default_rng(0))
    changed = change.instances(case.instance)
    assert isinstance(changed, Instances)
    assert changed.scale.tolist() == [[1.0, change.f_scale]]


def test_copy_of_parametric_problem_pickles() -> None:
    nlp, instances = nearest_in_box(np.array([[0.25, 4.0]]))
    copy = copies_of(Problem("p", "f", nlp, {"cold": instances}))[1]
    found = Ipopt().solve(pickle.loads(pickle.dumps(copy.nlp)), copy.starts["cold"])[0]
    np.testing.assert_allclose(copy.restored(answer(found.x)).x, [0.25, 1.0], atol=1e-6)

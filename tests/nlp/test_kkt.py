"""The judge: residuals at known solutions and away from them, relative errors, invalid values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import KNOWN, published
from hypothesis import given
from hypothesis import strategies as st
from known_problems import INF, Known, active_box, instances, known, planar

from casswarm.nlp import (
    Instances,
    Nlp,
    Residuals,
    Status,
    invalid_value,
    kkt_residuals,
    relative_error,
)
from casswarm.nlp.residuals import ACTIVE
from casswarm.solvers import Ipopt

each = pytest.mark.parametrize("case", KNOWN, ids=lambda case: case.nlp.name)
with_multipliers = pytest.mark.parametrize(
    "case",
    [active_box(), *map(published, (7, 21, 35, 71))],
    ids=lambda case: case.nlp.name,
)

ROUNDED = 3e-7  # the published digits of HS 71, times the curvature of its constraints


def judged(case: Known, x: object = None, *multipliers: object) -> Residuals:
    given = tuple(np.array(part, float) for part in multipliers)
    at = case.x if x is None else np.array(x, float)
    return kkt_residuals(case.nlp, case.instance, at, given or None)  # type: ignore[arg-type]


# --- at solutions


@each
def test_kkt_residuals_vanish_at_solution_also_with_estimated_multipliers(case: Known) -> None:
    known_ones = judged(case, None, case.bound_multipliers, case.row_multipliers)
    assert known_ones.violation < ROUNDED
    for residuals in (known_ones, judged(case)):
        assert residuals.stationarity < ROUNDED
        assert residuals.complementarity < ROUNDED


@with_multipliers
def test_multipliers_of_wrong_sign_are_not_stationary(case: Known) -> None:
    residuals = judged(case, None, -case.bound_multipliers, -case.row_multipliers)
    largest = np.abs([*case.bound_multipliers, *case.row_multipliers]).max()
    assert residuals.stationarity > largest / 2


@with_multipliers
def test_multiplier_is_derivative_of_objective_by_bound(case: Known) -> None:
    """The sign convention: the optimal value falls by the multiplier where its bound rises."""
    step, solver = 1e-4, Ipopt(tolerance=1e-11)

    def value(change: dict[str, np.ndarray]) -> float:
        moved = {name: getattr(case.instance, name) + by for name, by in change.items()}
        return solver.solve(case.nlp, replace(case.instance, **moved))[0].objective

    for multipliers, names in (
        (case.bound_multipliers, ("lbx", "ubx")),
        (case.row_multipliers, ("lbg", "ubg")),
    ):
        for row in np.flatnonzero(multipliers):
            shift = step * (np.arange(len(multipliers)) == row)
            ahead, behind = (value(dict.fromkeys(names, by)) for by in (shift, -shift))
            assert (ahead - behind) / (2 * step) == pytest.approx(-multipliers[row], rel=1e-3)


@each
def test_estimated_multipliers_match_those_of_ipopt(case: Known) -> None:
    solution = Ipopt().solve(case.nlp, case.instance)[0]
    estimated = kkt_residuals(case.nlp, case.instance, solution.x)
    assert solution.residuals.stationarity < 1e-6
    assert estimated.stationarity < 1e-6
    assert estimated.complementarity < 1e-6
    assert estimated.violation == solution.residuals.violation


@each
def test_sparse_estimate_equals_dense_one(case: Known, monkeypatch: pytest.MonkeyPatch) -> None:
    dense = judged(case)
    monkeypatch.setattr("casswarm.nlp.residuals._MAX_DENSE", 0)
    sparse = judged(case)
    assert sparse.stationarity == pytest.approx(dense.stationarity, abs=1e-6)


# --- away from solutions


def test_stationarity_is_largest_component_of_lagrangian_gradient() -> None:
    case = active_box()
    assert judged(case, [0.5, 2]).stationarity == 6  # gradient (-3, 6), no bound near
    assert judged(case, [0.5, 2], [1, 0], []).stationarity == 6
    assert judged(case, [0.5, 2], [-4, 0], []).stationarity == 7
    assert judged(published(6), [0, 0], [0, 0], [1]).stationarity == 10  # (-2, 0) + (0, 10)
    # bounds that are not active do not reduce it
    assert judged(case, [0, -1]).stationarity == pytest.approx(4)  # f falls towards the inside
    assert judged(case, [1, 3]).stationarity == pytest.approx(8)


@pytest.mark.parametrize(("distance", "stationarity"), [(0.5 * ACTIVE, 0), (2 * ACTIVE, 2)])
def test_estimate_uses_only_active_rows(distance: float, stationarity: float) -> None:
    residuals = judged(active_box(), [1 - distance, -1])
    assert residuals.stationarity == pytest.approx(stationarity, abs=1e-5)


def test_complementarity_is_largest_product_with_slack() -> None:
    case = active_box()
    assert judged(case, [0.75, -1], [2, 0], []).complementarity == 0.5
    assert judged(case, [0.75, -1], [-2, 0], []).complementarity == 1.5
    assert judged(case, [0.75, -1], [0, -4], []).complementarity == 8
    assert judged(case, [0.75, -1], [0, 0], []).complementarity == 0
    # infinite bounds have a slack of one
    assert judged(published(35), None, [0.5, 0, 0], [2 / 9]).complementarity == 0.5
    assert judged(published(35), None, [0, 0, 0], [-0.25]).complementarity == 0.25


# --- violation


@pytest.mark.parametrize(
    ("x", "violation", "worst"),
    [
        ([0.5, 0.5], 0, ""),
        ([-0.25, -0.25], 0.25, "bound[0]"),
        ([-2, -3], 3, "bound[1]"),
        ([1, 1], 1, "sum[0]"),
        ([0, 1.5], 1.5, "difference[0]"),
        ([1.5, 0], 1.5, "difference[0]"),
    ],
)
def test_kkt_residuals_name_violated_row(x: list[float], violation: float, worst: str) -> None:
    case = known(
        "triangle",
        ca.sumsqr,
        ([0, 0], 0),
        [0, 0],
        box=([0, 0], [1, 1]),
        rows={
            "sum": (lambda x: x[0] + x[1], -INF, 1),
            "difference": (lambda x: x[0] - x[1], 0, 0),
        },
    )
    residuals = judged(case, x)
    assert (residuals.violation, residuals.violated_row) == (violation, worst)


def test_violated_row_is_named_by_block_and_index() -> None:
    discs = np.array([[0.0, 0, 1], [3, 0, 1], [6, 0, 1]])
    wide = np.full((3, 2), 9.0)
    nlp, instance = planar(ca.sumsqr, np.zeros((3, 2)), -wide, wide, discs)
    residuals = kkt_residuals(nlp, instance, np.array([0.5, 0, 3, 3, 6, 2.0]))
    assert (residuals.violation, residuals.violated_row) == (8, "discs[1]")


# --- not finite


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_non_finite_answer_has_infinite_residuals(value: float) -> None:
    expected = Residuals(INF, INF, INF, "not finite")
    assert judged(published(35), [value, 0, 0]) == expected
    assert judged(published(35), [value, 0, 0], [0, 0, 0], [0]) == expected
    unseen = known("unseen", lambda x: x[1] ** 2, ([0, 0], 0), [0, 0])
    assert judged(unseen, [value, 0]) == expected


@pytest.mark.parametrize("rows", [{}, {"root": (lambda x: ca.sqrt(x[0]), 0, 1)}])
def test_non_finite_functions_have_infinite_residuals(rows: dict[str, object]) -> None:
    objective = ca.sumsqr if rows else (lambda x: ca.log(x[0]))
    case = known("outside", objective, ([-1], 0), [-1], rows=rows)  # type: ignore[arg-type]
    assert judged(case) == Residuals(INF, INF, INF, "not finite")


def test_kkt_residuals_use_parameters_of_instance() -> None:
    x, q = ca.MX.sym("x"), ca.MX.sym("q")
    nlp = Nlp("shifted", {"x": x}, {"q": q}, (x - q) ** 2, {"above": x - q})
    for goal in (1.0, 3.0):
        instance = instances([goal], [goal], lbx=goal - 9, ubx=goal + 9, lbg=0.0, ubg=INF)
        assert kkt_residuals(nlp, instance, np.array([goal])) == Residuals(0, 0, 0)
        assert kkt_residuals(nlp, instance, np.array([goal - 0.5])).violation == 0.5


# --- the scale-invariant error


UNITS = st.sampled_from([1e-6, 1e-2, 1.0, 32.0, 1e5])


def scaled(unit: float, objective: float, row: float) -> Known:
    """Problem 35 with other units of x, of f and of its constraint."""
    original = published(35)
    function = ca.Function("f", [original.nlp.x], [original.nlp.objective, original.nlp.g])

    def part(number: int, factor: float) -> Callable[[Any], Any]:
        return lambda x: factor * function(x / unit)[number]

    return known(
        "scaled",
        part(0, objective),
        ((unit * original.x).tolist(), objective * original.objective),
        [unit * 0.5] * 3,
        box=([0.0] * 3, [INF] * 3),
        rows={"budget": (part(1, row), -INF, 3 * row)},
        bound_multipliers=[0.0] * 3,
        row_multipliers=(objective / row * original.row_multipliers).tolist(),
    )


@pytest.mark.parametrize("case", KNOWN, ids=lambda case: case.nlp.name)
def test_relative_error_at_published_optimum_is_small(case: Known) -> None:
    multipliers = case.bound_multipliers, case.row_multipliers
    assert relative_error(case.nlp, case.instance, case.x, multipliers) < 1e-7
    assert relative_error(case.nlp, case.instance, case.x) < 1e-5  # printed to eight digits


@given(UNITS, UNITS, UNITS, st.sampled_from([0.0, 1e-5, 1e-2, 0.3]))
def test_relative_error_is_independent_of_units(
    unit: float, objective: float, row: float, step: float
) -> None:
    reference, case = scaled(1.0, 1.0, 1.0), scaled(unit, objective, row)
    direction = np.array([1.0, -0.5, 0.25])
    expected, error = (
        relative_error(
            each.nlp,
            each.instance,
            each.x + step * size * direction,
            (each.bound_multipliers, each.row_multipliers),
        )
        for each, size in ((reference, 1.0), (case, unit))
    )
    assert error == pytest.approx(expected, rel=1e-6, abs=1e-13)
    assert bool(error > 1e-6) == bool(step)


def test_relative_error_of_interior_point_is_gradient_over_that_of_the_start() -> None:
    case = known("bowl", lambda x: 50 * ca.sumsqr(x), ([0, 0], 0), [3, 4])
    error = relative_error(case.nlp, case.instance, np.array([0.003, 0.004]))
    assert error == pytest.approx(1e-3)


def test_relative_error_of_violation_is_a_relative_distance() -> None:
    # the row 1000 (x - 2) >= 0 at 1.9: a distance of 0.1, relative to |x| = 1.9
    case = known(
        "wall", lambda x: x[0], ([2], 2), [1.0], rows={"wall": (lambda x: 1e3 * (x - 2), 0, INF)}
    )
    multipliers = np.zeros(1), np.array([-1e-3])
    error = relative_error(case.nlp, case.instance, np.array([1.9]), multipliers)
    assert error == pytest.approx(0.1 / 1.9)


def test_relative_error_of_multiplier_of_inactive_row_is_the_smaller_of_both() -> None:
    case = known("slope", lambda x: x[0], ([0], 0), [1.0], box=([0], [INF]))
    at_distance = relative_error(
        case.nlp, case.instance, np.array([1.0]), (np.array([-1.0]), np.zeros(0))
    )
    assert at_distance == 1.0  # the bound is as far as x is long, its multiplier as large as f'
    near = relative_error(
        case.nlp, case.instance, np.array([1e-3]), (np.array([-1.0]), np.zeros(0))
    )
    assert near == pytest.approx(1e-3 / 0.999)


def test_relative_error_is_infinite_where_it_cannot_be_measured() -> None:
    case = known("flat", lambda x: x[0], ([0], 0), [1.0], rows={"row": (lambda x: x**2, -2, -1)})
    assert relative_error(case.nlp, case.instance, np.array([np.nan])) == INF
    assert relative_error(case.nlp, case.instance, np.array([0.0])) == INF  # violated, no gradient


def test_relative_error_has_the_scale_of_a_given_reference() -> None:
    case = known("bowl", lambda x: 50 * ca.sumsqr(x), ([0, 0], 0), [0, 0])
    x = np.array([0.003, 0.004])
    far = relative_error(case.nlp, case.instance, x, reference=np.array([3.0, 4.0]))
    assert far == pytest.approx(1e-3)
    assert relative_error(case.nlp, case.instance, x) == pytest.approx(1.0)


# --- values that are not finite

X = ca.MX.sym("x", 2)
ROOT = ca.sqrt(ca.fmax(-(X[1] ** 2), 0))  # 0 everywhere, with derivatives that are not a number
SLOPE = "the derivative of the {} with respect to x[1] is nan"


def posed(f, g=None):
    program = Nlp.from_expressions("named", X, ca.MX(0, 1), f, ca.MX(0, 1) if g is None else g)
    rows = program.sizes[2]
    bounds = np.full((1, 2), np.inf), np.full((1, rows), np.inf)
    instance = Instances(
        x0=np.ones((1, 2)), p=np.zeros((1, 0)),
        lbx=-bounds[0], ubx=bounds[0], lbg=-bounds[1], ubg=bounds[1],
    )  # fmt: skip
    return program, instance


@pytest.mark.parametrize(
    ("f", "g", "x", "expected"),
    [
        (X[0] ** 2, None, [2.0, 1.0], ""),
        (ca.log(X[0]), None, [-1.0, 1.0], "the objective is nan"),
        (X[0], ca.vertcat(X[1], 1 / X[0]), [0.0, 1.0], "the constraint g[1] is inf"),
        (X[0] + ROOT, None, [2.0, 1.0], SLOPE.format("objective")),
        (X[0], ROOT, [2.0, 1.0], SLOPE.format("constraint g[0]")),
        (X[0] + ROOT, None, [np.nan, 1.0], SLOPE.format("objective") + " at the initial guess"),
    ],
)  # fmt: skip
def test_invalid_value_is_named(f, g, x, expected):
    assert invalid_value(*posed(f, g), np.array(x)) == expected


def test_solution_that_failed_says_which_derivative_is_not_finite():
    (found,) = Ipopt().solve(*posed((X[0] - 3) ** 2 + ROOT))
    assert found.status is Status.FAILED
    assert "the derivative of the objective with respect to x[1] is nan" in found.message

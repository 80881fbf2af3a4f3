"""The scale-invariant error of the optimality conditions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import KNOWN, published
from hypothesis import given
from hypothesis import strategies as st
from known_problems import INF, Known, known

from casswarm.nlp import relative_error

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

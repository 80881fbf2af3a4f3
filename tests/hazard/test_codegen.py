"""Kernels as NumPy source: every operation against CasADi's own evaluation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from casadi_operations import BINARY, UNARY
from hypothesis import given, settings
from hypothesis import strategies as st

from casswarm.errors import HazardError
from casswarm.hazard import SaturationCollision
from casswarm.hazard.codegen import (
    differentiated_kernels,
    lower,
    lower_source,
    lowered_kernels,
)
from casswarm.nlp import operations


def used(kernel: Callable[..., Any], inputs: int) -> set[int]:
    symbols = [ca.SX.sym(f"x{i}") for i in range(inputs)]
    function = ca.Function("kernel", symbols, [kernel(*symbols)])
    return {function.instruction_id(k) for k in range(function.n_instructions())}


def compare(kernel: Callable[..., Any], *arguments: list[float]) -> None:
    """Values over arrays equal CasADi's, one point at a time."""
    symbols = [ca.SX.sym(f"x{i}") for i in range(len(arguments))]
    function = ca.Function("kernel", symbols, [kernel(*symbols)])
    expected = [float(function(*point)) for point in zip(*arguments, strict=True)]
    values = lower(kernel, len(arguments), "kernel")(*map(np.array, arguments))
    np.testing.assert_allclose(values, expected, rtol=1e-14, atol=1e-300)


def numbers(limits: tuple[float, float]) -> st.SearchStrategy[list[float]]:
    """Lists of seven numbers, whole ones, so equal ones and zeros, among them."""
    low, high = limits
    whole = st.integers(int(np.ceil(low)), int(high)).map(float)
    return st.lists(st.one_of(whole, st.floats(low, high)), min_size=7, max_size=7)


def test_all_operations_are_compared() -> None:
    # an assignment is nothing that an expression could ask for
    assert {*UNARY, *BINARY, ca.OP_ASSIGN} == {
        code for code, each in operations.OPERATIONS.items() if each.array
    }


@pytest.mark.parametrize("operation", [*UNARY, *BINARY], ids=operations.operation_name)
def test_operation_equals_casadi(operation: int) -> None:
    kernel, limits = UNARY.get(operation) or BINARY[operation]
    inputs = 1 if operation in UNARY else 2
    assert operation in used(kernel, inputs)

    @settings(max_examples=15, deadline=None, derandomize=True)
    @given(points=st.tuples(*[numbers(limits)] * inputs))
    def check(points: tuple[list[float], ...]) -> None:
        compare(kernel, *points)

    check()


def test_intermediate_results_are_not_overwritten() -> None:
    def kernel(x: Any, y: Any, z: Any) -> Any:
        a, b = ca.exp(-x / 2), ca.sin(y) * z
        c = a * b + x
        return ca.if_else(c > 1, a / (1 + c**2), ca.fmax(b, z)) + ca.sqrt(1 + a * c * b)

    rng = np.random.default_rng(0)
    compare(kernel, *rng.uniform(0, 1, (3, 200)).tolist())


@pytest.mark.parametrize("value", [2.5, np.inf, -np.inf, 0.1 + 0.2])
def test_constant_keeps_every_digit(value: float) -> None:
    assert lower(lambda x: ca.SX(value), 1, "constant")(np.zeros(3)) == value  # noqa: ARG005
    values = lower(lambda x: x + value, 1, "shifted")(np.zeros(3))
    assert values.tolist() == [value] * 3


def test_branch_not_taken_gives_no_nan() -> None:
    kernel = lower(lambda x: ca.if_else(x > 0, ca.log(x), -1), 1, "kernel")
    with np.errstate(all="ignore"):
        assert kernel(np.array([-1.0, 0.0, 1.0])).tolist() == [-1, -1, 0]


def test_lowered_function_keeps_array_shape() -> None:
    kernel = lower(lambda x, y: x * y + 1, 2, "kernel")
    values = kernel(np.ones((2, 1, 3)), np.arange(4.0)[:, None])
    assert values.shape == (2, 4, 3)
    assert values[1, :, 2].tolist() == [1, 2, 3, 4]


def test_source_has_one_line_per_operation() -> None:
    x = ca.SX.sym("x")
    source = lower_source("density", {"x": x}, [1 / (1 + 3 * x)])
    assert source.startswith("def density(x):\n    w0 = ")
    assert source.rstrip().splitlines()[-1] == "    return y0"
    # a line each: x, 3, their product, 1, the sum, its inverse
    assert sum(line.startswith("    w") for line in source.splitlines()) == 6


def test_divisions_by_the_same_number_share_its_inverse() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    square = (x + y) * (x + y)
    expressions = [x / square, 1 / square, y / square + square / (y + 3)]
    source = lower_source("f", {"x": x, "y": y}, expressions)
    assert source.count(" / ") == 2
    namespace: dict[str, Any] = {}
    exec(source, namespace)
    expected = [float(each) for each in ca.Function("f", [x, y], expressions)(1.7, -0.4)]
    np.testing.assert_allclose(namespace["f"](1.7, -0.4), expected, rtol=1e-15)


def test_inverse_is_not_that_of_a_number_written_later() -> None:
    compare(lambda x, y: x / (y + 1) + y / (y + 1) + x / (x / (y + 1) + 2), [1.0, 4.0], [2.0, 0.5])


@pytest.mark.parametrize("beta_2", [2.0, 6.0, 10.0, 16.0, 18.0, 5.0, 2.5])
def test_collision_rate_is_the_same_as_product_and_exponential(beta_2: float) -> None:
    hazard = SaturationCollision(((0.0, 0.0),), beta_1=0.3, beta_2=beta_2)
    distances = np.array([0.02, 0.1, 0.3, 1.0, 7.0])
    expected = (0.3 / distances) ** beta_2
    np.testing.assert_allclose(lowered_kernels(hazard)[2](distances**2), expected, rtol=1e-12)
    source, parameters = differentiated_kernels(hazard)
    assert (beta_2 in parameters) is (beta_2 in (18.0, 5.0, 2.5))
    assert ("np.exp" in source) is (beta_2 in parameters)


def test_source_indexes_columns_and_returns_tuples() -> None:
    x, c = ca.SX.sym("x"), ca.SX.sym("c", 2)
    source = lower_source("f", {"x": x, "c": c}, [c[1] * x, ca.SX(0), x - c[0]])
    namespace: dict[str, Any] = {}
    exec(source, namespace)
    assert namespace["f"](3.0, [5.0, 7.0]) == (21.0, 0.0, -2.0)


@pytest.mark.parametrize(
    ("kernel", "name"), [(ca.erf, "OP_ERF"), (ca.asin, "OP_ASIN"), (ca.acosh, "OP_ACOSH")]
)
def test_unsupported_operation_is_named(kernel: Callable[..., Any], name: str) -> None:
    with pytest.raises(HazardError) as caught:
        lower(kernel, 1, "source")
    assert str(caught.value) == (
        f"kernel 'source' uses CasADi's {name}, which cannot be evaluated over arrays; "
        "write the kernel without it"
    )

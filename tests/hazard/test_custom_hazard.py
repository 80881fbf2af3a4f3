"""Rates of a user's own: the same numbers as the built-in ones, and readable errors."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hazard_cases import Array, symbolic
from refusals import refused

from casswarm.errors import HazardError
from casswarm.hazard import CustomHazard, Saturation, SaturationCollision

RADARS = ((4.4, 4.6), (4.5, 3.0))
CONSTANTS: Any = {"alpha_1": 3.0, "alpha_2": 2.0, "alpha_3": 5.0, "beta_1": 0.3, "beta_2": 4}


def paper_rates(
    positions: Any,
    alive: Any,
    radars: Any,
    alpha_1: float,
    alpha_2: float,
    alpha_3: float,
    beta_1: float,
    beta_2: float,
) -> Any:
    """Scenario II of the paper, as somebody might write it down: loops, no regularisation."""
    n = positions.shape[0]

    def squared(i: int, j: int) -> Any:
        return ca.sumsqr(positions[i, :] - positions[j, :])

    rates = []
    for i in range(n):
        density = sum(alive[j] / (1 + alpha_3 * squared(i, j)) for j in range(n))
        collision = sum(
            alive[j] * (beta_1**2 / squared(i, j)) ** (beta_2 / 2) for j in range(n) if j != i
        )
        source = sum(alpha_1 / ca.sumsqr(positions[i, :].T - ca.DM(radar)) for radar in radars)
        rates.append(source / (1 + alpha_2 * density) + collision)
    return ca.vertcat(*rates)


def height(positions: Any, alive: Any, scale: float = 1.0) -> Any:  # noqa: ARG001
    return scale * positions[:, 1]


def root(positions: Any, alive: Any) -> Any:
    return ca.sqrt(height(positions, alive))


def tabulated(positions: Any, alive: Any, radars: Any, table: Any, label: str) -> Any:  # noqa: ARG001
    assert label == "any text"
    assert radars == RADARS
    assert table == ((1.0, 2.0), (3.0, 4.0))
    return table[1][0] + 0 * positions[:, 0]


@pytest.fixture(scope="module")
def own() -> CustomHazard:
    return CustomHazard(paper_rates, RADARS, CONSTANTS)


@pytest.fixture(scope="module")
def builtin() -> SaturationCollision:
    return SaturationCollision(RADARS, **CONSTANTS)


# --- the same formula gives the same numbers


@pytest.mark.parametrize("n", [1, 2, 5])
def test_custom_paper_formula_equals_builtin_rates(
    own: CustomHazard, builtin: SaturationCollision, n: int
) -> None:
    rng = np.random.default_rng(n)
    positions, alive = rng.uniform(0, 6, (300, n, 2)), rng.random((300, n)) < 0.6
    rates = own.rates(positions, alive)
    np.testing.assert_allclose(rates, builtin.rates(positions, alive), rtol=1e-11)
    assert (rates[~alive] == 0).all()
    for mine, theirs in zip(
        symbolic(own, n)(positions[0].T, alive[0]),
        symbolic(builtin, n)(positions[0].T, alive[0]),
        strict=True,
    ):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-12)


def test_custom_single_agent_rate_equals_builtin(
    own: CustomHazard, builtin: SaturationCollision
) -> None:
    points = np.random.default_rng(1).uniform(0, 6, (7, 2))
    np.testing.assert_allclose(
        own.single_agent_rates(points), builtin.single_agent_rates(points), rtol=1e-12
    )
    x = ca.MX.sym("x", 2, 7)
    values = []
    for hazard in (own, builtin):
        lone = hazard.single_agent_expression(x)
        slope = ca.gradient(ca.sum2(lone), x)
        values.append(ca.Function("lone", [x], [ca.vertcat(lone, slope)])(points.T))
    np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("chunk", [1, 3, 256])
def test_custom_rates_of_batch_equal_single_states(
    own: CustomHazard, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    states, alive = rng.normal(size=(7, 3, 2)), rng.random((7, 3)) < 0.7
    singles = np.array([own.rates(x, a) for x, a in zip(states, alive, strict=True)])
    monkeypatch.setattr("casswarm.hazard.custom._CHUNK", chunk)
    for size in (1, 2, 7):
        np.testing.assert_array_equal(own.rates(states[:size], alive[:size]), singles[:size])
    assert own.rates(states[:0], alive[:0]).shape == (0, 3)


def test_custom_rates_may_be_row_column_or_numbers() -> None:
    row = CustomHazard(lambda positions, alive: (positions[:, 1] + alive).T)
    assert row.rates([[0, 1], [0, 2]]).tolist() == [2, 3]
    assert CustomHazard(height).rates([[0, 1], [0, 2]]).tolist() == [1, 2]
    calm = CustomHazard(lambda positions, alive: np.zeros(positions.shape[0]))  # noqa: ARG005
    assert calm.rates([[0, 1], [0, 2]]).tolist() == [0, 0]


def test_custom_function_receives_alive_as_ones() -> None:
    counted = CustomHazard(lambda positions, alive: 0 * positions[:, 0] + ca.sum1(alive))
    assert counted.rates(np.zeros((3, 2)), [True, False, True]).tolist() == [2, 0, 2]


# --- parameters


def test_parameters_and_radars_arrive_as_tuples() -> None:
    parameters = {"table": [[1.0, 2.0], np.array([3.0, 4.0])], "label": "any text"}
    hazard = CustomHazard(tabulated, [list(r) for r in RADARS], parameters)  # type: ignore[arg-type]
    assert hazard.rates([[0, 0]]).tolist() == [3]
    assert hazard.radar_positions.tolist() == [list(radar) for radar in RADARS]


def test_radars_are_passed_only_if_given() -> None:
    assert CustomHazard(height).radar_positions.shape == (0, 2)


def test_custom_hazards_of_equal_arguments_are_equal() -> None:
    one, other = (CustomHazard(height, (), {"scale": scale}) for scale in (2, 2.0))
    assert one == other
    assert hash(one) == hash(other)
    assert one != CustomHazard(height, (), {"scale": 3})
    assert one != CustomHazard(height)
    assert one != Saturation(RADARS)


# --- errors


def broken(positions: Any, alive: Any) -> Any:  # noqa: ARG001
    raise LookupError("no such radar")


def scaled(positions: Any, alive: Any, strength: float) -> Any:  # noqa: ARG001
    return strength * alive


def pair(positions: Any, alive: Any) -> Any:
    return alive * (positions[1, 0] if positions.shape[0] == 1 else 1.0)


UNKNOWN = {"value": ["alpha_1", "radars"], "expected": ["positions", "alive", "strength"]}
REFUSED: list[tuple[tuple[Any, ...], str, dict[str, Any]]] = [
    (
        (broken,),
        "broken' failed on 1 member with CasADi arguments: LookupError: no such radar",
        {"hazard": "hazard 'broken'", "members": 1},
    ),
    (
        (scaled, [(0, 0)], {"strength": 1.0, "alpha_1": 3.0}),
        "scaled' takes positions, alive, strength, not alpha_1, radars: remove "
        "hazard.parameters.alpha_1, hazard.radars from the scenario, where a template",
        UNKNOWN,
    ),
    ((height, RADARS), "takes positions, alive, scale, not radars", {}),
    ((3,), "3 is not a function of (positions, alive)", {"function": "3"}),
    ((pair,), "failed on 1 member", {"members": 1}),
    ((height, (1.0, 2.0)), "radars have shape (2,); expected (k, 2)", {"key": "radars"}),
    ((height, ((1.0, np.inf),)), "radars must be finite", {"key": "radars"}),
    ((height, "here"), "radars are 'here'; expected k pairs (x, y) of numbers", {}),
]


@pytest.mark.parametrize(("arguments", "words", "values"), REFUSED)
def test_wrong_arguments_are_explained(
    arguments: tuple[Any, ...], words: str, values: dict[str, Any]
) -> None:
    error = refused(HazardError, CustomHazard, *arguments)
    assert words in str(error)
    assert {key: getattr(error, key) for key in values} == values


@pytest.mark.parametrize("value", [{1, 2}, ca.DM([1, 2]), [bytearray()]])
def test_unhashable_parameter_is_named(value: object) -> None:
    text = str(refused(HazardError, CustomHazard, height, (), {"scale": value}))
    assert text.startswith("parameter 'scale' is ")
    assert text.endswith("; allowed: numbers, texts, lists of these")


@pytest.mark.parametrize(
    ("returned", "words", "shape"),
    [
        (lambda x: x, "returned shape (1, 2) for 1 member; expected (1, 1)", (1, 2)),
        (lambda x: ca.sum1(x[:, 0]), "shape (1, 1) for 2 members; expected (2, 1)", (1, 1)),
        (lambda _: 0.5, "returned shape (1, 1) for 2 members; expected (2, 1)", (1, 1)),
        (lambda _: None, "returned None, a NoneType; expected a CasADi expression", None),
        (lambda _: "much", "returned 'much', a str; expected a CasADi expression", None),
    ],
)
def test_wrong_return_value_is_shown(
    returned: Callable[[Any], Any], words: str, shape: tuple[int, int] | None
) -> None:
    def mine(positions: Any, alive: Any) -> Any:  # noqa: ARG001
        return returned(positions)

    error = refused(HazardError, CustomHazard, mine)
    assert str(error).startswith("hazard ")
    assert "mine' " in str(error)
    assert words in str(error)
    assert "\n" not in str(error)
    if shape is not None:
        members = 2 if "2 members" in words else 1
        assert (error.members, error.shape, error.expected) == (members, shape, (members, 1))


def test_function_with_any_keywords_is_taken() -> None:
    parameters = {"strength": 1.0, "alpha_1": 3.0}
    assert CustomHazard(lambda *_, **keywords: keywords["strength"] * _[1], (), parameters)


@pytest.mark.parametrize(("function", "value"), [(height, "-2"), (root, "nan")])
def test_invalid_rate_names_the_member(function: Callable[..., Any], value: str) -> None:
    hazard = CustomHazard(function)
    error = refused(HazardError, hazard.rates, [[[0, 1], [3, 1]], [[0, 1], [3.5, -2]]])
    assert f"gives the rate {value}" in str(error)
    assert "for member 1 at (3.5, -2); rates must be finite and not negative" in str(error)
    assert (error.hazard, error.state) == (f"hazard {function.__name__!r}", 1)
    assert (error.member, error.position) == (1, (3.5, -2.0))
    np.testing.assert_equal(error.rate, float(value))
    alive = [[True, True], [True, False]]  # of the destroyed, nobody asks
    assert hazard.rates([[[0, 1], [3, 1]], [[0, 1], [3.5, -2]]], alive)[1].tolist() == [1, 0]


# --- lower bounds over boxes, and the check of them


def ramp(positions: ca.MX, alive: ca.MX) -> ca.MX:  # noqa: ARG001
    return 1 + positions[:, 0] ** 2


def dip(positions: ca.MX, alive: ca.MX) -> ca.MX:  # noqa: ARG001
    return 2 - ca.exp(-(((positions[:, 0] - 0.3) / 0.2) ** 2))


def at_centre(lower: Array, upper: Array) -> Array:
    return np.asarray(1 + (0.5 * (lower + upper))[..., 0] ** 2)


def at_corners_and_centre(lower: Array, upper: Array) -> Array:
    x = np.stack([lower, upper, 0.5 * (lower + upper)])[..., 0]
    return np.asarray((2 - np.exp(-(((x - 0.3) / 0.2) ** 2))).min(axis=0))


@pytest.mark.parametrize(
    ("rate", "bound", "where"),
    [
        (ramp, at_centre, r"it is 1\.25 for the box from \(0, 0\) to \(1, 1\), where .* is 1$"),
        (dip, at_corners_and_centre, r"it is 1\.63212 for the box from \(0, 0\) to \(1, 1\)"),
    ],
)
@pytest.mark.parametrize("count", [1, 500])
def test_lower_bound_above_rate_in_a_box_raises(
    rate: Callable[..., Any], bound: Callable[..., Array], where: str, count: int
) -> None:
    hazard = CustomHazard(rate, lower_bound=bound)
    lower, upper = np.zeros((count, 2)), np.ones((count, 2))
    error = refused(HazardError, hazard.single_agent_lower_bound, lower, upper)
    assert re.search(where, str(error))
    assert error.bound > error.rate
    assert rate(ca.DM([error.position]), None)[0] == pytest.approx(error.rate)


def test_lower_bound_of_nan_raises() -> None:
    def undefined(lower: Array, upper: Array) -> Array:  # noqa: ARG001
        return np.where(lower[..., 0] == 7, np.nan, 0.0)

    lower = np.arange(900.0)[:, None] + np.zeros(2)
    hazard = CustomHazard(ramp, lower_bound=undefined)
    with pytest.raises(HazardError, match=r"it is nan for the box from \(7, 7\) to \(8, 8\)"):
        hazard.single_agent_lower_bound(lower, lower + 1)


def test_lower_bound_below_rates_is_returned() -> None:
    hazard = CustomHazard(ramp, lower_bound=lambda lower, upper: 1 + 0 * (lower + upper)[..., 0])
    lower = np.linspace(0, 1, 600).reshape(30, 10, 2)
    assert hazard.single_agent_lower_bound(lower, lower + 1).shape == (30, 10)

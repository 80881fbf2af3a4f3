"""Rates of a user's own: the same numbers as the built-in ones, and readable errors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hazard_cases import Array, symbolic
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from casswarm.errors import HazardError
from casswarm.grid.nodes import multilinear
from casswarm.hazard import CustomHazard, Saturation, SaturationCollision

RADARS = ((4.4, 4.6), (4.5, 3.0))
CONSTANTS: Any = {"alpha_1": 3.0, "alpha_2": 2.0, "alpha_3": 5.0, "beta_1": 0.3, "beta_2": 4}


def paper_rates(positions, alive, radars, alpha_1, alpha_2, alpha_3, beta_1, beta_2):
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


OWN = CustomHazard(paper_rates, RADARS, CONSTANTS)
BUILTIN = SaturationCollision(RADARS, **CONSTANTS)


# --- the same formula gives the same numbers


@pytest.mark.parametrize("n", [1, 2, 5])
def test_custom_paper_formula_equals_builtin_rates(n: int) -> None:
    rng = np.random.default_rng(n)
    positions, alive = rng.uniform(0, 6, (300, n, 2)), rng.random((300, n)) < 0.6
    rates = OWN.rates(positions, alive)
    np.testing.assert_allclose(rates, BUILTIN.rates(positions, alive), rtol=1e-11)
    assert (rates[~alive] == 0).all()
    symbols = (symbolic(each, n)(positions[0].T, alive[0]) for each in (OWN, BUILTIN))
    for mine, theirs in zip(*symbols, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-12)


def test_custom_single_agent_rate_equals_builtin() -> None:
    points = np.random.default_rng(1).uniform(0, 6, (7, 2))
    found, expected = (each.single_agent_rates(points) for each in (OWN, BUILTIN))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    x = ca.MX.sym("x", 2, 7)
    values = []
    for hazard in (OWN, BUILTIN):
        lone = hazard.single_agent_expression(x)
        slope = ca.gradient(ca.sum2(lone), x)
        values.append(ca.Function("lone", [x], [ca.vertcat(lone, slope)])(points.T))
    np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("chunk", [1, 3, 256])
def test_custom_rates_of_batch_equal_single_states(
    chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    states, alive = rng.normal(size=(7, 3, 2)), rng.random((7, 3)) < 0.7
    singles = np.array([OWN.rates(x, a) for x, a in zip(states, alive, strict=True)])
    monkeypatch.setattr("casswarm.hazard.custom._CHUNK", chunk)
    for size in (1, 2, 7):
        np.testing.assert_array_equal(OWN.rates(states[:size], alive[:size]), singles[:size])
    assert OWN.rates(states[:0], alive[:0]).shape == (0, 3)


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


UNKNOWN = (scaled, [(0, 0)], {"strength": 1.0, "alpha_1": 3.0})
REFUSED: list[tuple[tuple[Any, ...], str]] = [
    ((broken,), "broken' failed on 1 member with CasADi arguments: LookupError: no such radar"),
    (UNKNOWN, "scaled' takes positions, alive, strength, not alpha_1, radars: remove"),
    (UNKNOWN, "hazard.parameters.alpha_1, hazard.radars from the scenario, where a template"),
    ((height, RADARS), "takes positions, alive, scale, not radars"),
    ((pair,), "failed on 1 member"),
    ((height, (1.0, 2.0)), "radars have shape (2,); expected (k, 2)"),
    ((height, ((1.0, np.inf),)), "radars must be finite"),
    ((height, "here"), "radars are 'here'; expected k pairs (x, y) of numbers"),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED)
def test_wrong_arguments_are_explained(arguments: tuple[Any, ...], words: str) -> None:
    assert words in refused(CustomHazard, *arguments)
    assert refused(CustomHazard, 3) == "3 is not a function of (positions, alive)"


@pytest.mark.parametrize("value", [{1, 2}, ca.DM([1, 2]), [bytearray()]])
def test_unhashable_parameter_is_named(value: object) -> None:
    text = refused(CustomHazard, height, (), {"scale": value})
    assert text.startswith("parameter 'scale' is ")
    assert text.endswith("; allowed: numbers, texts, lists of these")


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (lambda x: x, "returned shape (1, 2) for 1 member; expected (1, 1)"),
        (lambda x: ca.sum1(x[:, 0]), "returned shape (1, 1) for 2 members; expected (2, 1)"),
        (lambda _: 0.5, "returned shape (1, 1) for 2 members; expected (2, 1)"),
        (lambda _: None, "returned None, a NoneType; expected a CasADi expression"),
        (lambda _: "much", "returned 'much', a str; expected a CasADi expression"),
    ],
)
def test_wrong_return_value_is_shown(returned: Callable[[Any], Any], words: str) -> None:
    def mine(positions: Any, alive: Any) -> Any:  # noqa: ARG001
        return returned(positions)

    text = refused(CustomHazard, mine)
    assert text.startswith("hazard ")
    assert "mine' " in text
    assert words in text
    assert "\n" not in text


def test_function_with_any_keywords_is_taken() -> None:
    parameters = {"strength": 1.0, "alpha_1": 3.0}
    assert CustomHazard(lambda *_, **keywords: keywords["strength"] * _[1], (), parameters)


@pytest.mark.parametrize(("function", "value"), [(height, "-2"), (root, "nan")])
def test_invalid_rate_names_the_member(function: Callable[..., Any], value: str) -> None:
    hazard = CustomHazard(function)
    text = refused(hazard.rates, [[[0, 1], [3, 1]], [[0, 1], [3.5, -2]]])
    assert f"gives the rate {value}" in text
    assert "for member 1 at (3.5, -2); rates must be finite and not negative" in text
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
    with pytest.raises(HazardError, match=where):
        hazard.single_agent_lower_bound(lower, upper)


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


def peak(positions, alive):
    """A rate that falls from 10 with the distance from (0.3, -0.2)."""
    del alive
    return 1.0 / ((positions[:, 0] - 0.3) ** 2 + (positions[:, 1] + 0.2) ** 2 + 0.1)


def below_peak(lower, upper):
    """Rates at the corners that are the farthest away."""
    center = np.array([0.3, -0.2])
    farthest = np.maximum(np.abs(lower - center), np.abs(upper - center))
    return 1.0 / ((farthest**2).sum(axis=-1) + 0.1)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.1, 0.5]))
@settings(max_examples=40, deadline=None)
def test_node_values_are_below_rates_and_closer_than_bounds_of_cells(seed, spacing) -> None:
    rng = np.random.default_rng(seed)
    hazard = CustomHazard(peak, lower_bound=below_peak)
    east, north = (rng.uniform(-1, 1) + spacing * np.arange(count) for count in (9, 7))
    values = hazard.single_agent_rates_below(east, north, spacing)
    cells = np.stack([rng.integers(0, 8, 400), rng.integers(0, 6, 400)], axis=-1)
    fractions = rng.uniform(0, 1, (400, 2))
    points = np.array([east[0], north[0]]) + spacing * (cells + fractions)
    rates = hazard.single_agent_rates(points)
    assert (multilinear(values, cells, fractions) <= rates).all()
    nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
    exact = hazard.single_agent_rates(nodes)
    around = hazard.single_agent_lower_bound(nodes - spacing, nodes + spacing)
    if spacing < 0.5:
        assert (exact - values).max() < 0.6 * (exact - around).max()

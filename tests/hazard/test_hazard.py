"""Hazards as objects: shapes, errors, equality, pickles, kernels of a user's own."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hazard_cases import symbolic
from refusals import refused

from casswarm.errors import CasswarmError, HazardError
from casswarm.hazard import Hazard, KernelHazard, Saturation, SaturationCollision

RADARS = ((4.4, 4.6), (4.5, 3.0))
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.fixture
def hazard() -> Saturation:
    return Saturation(RADARS)


# --- shapes


def test_rates_have_the_shape_of_the_state(hazard: Hazard) -> None:
    assert hazard.rates(SQUARE).shape == (4,)
    assert hazard.rates(SQUARE.tolist(), [1, 0, 1, 1]).shape == (4,)
    assert hazard.rates(np.stack([SQUARE] * 3)).shape == (3, 4)
    assert hazard.rates(np.empty((0, 4, 2))).shape == (0, 4)
    assert hazard.rates(SQUARE).dtype == float


def test_all_members_are_alive_by_default(hazard: Hazard) -> None:
    np.testing.assert_array_equal(hazard.rates(SQUARE), hazard.rates(SQUARE, np.ones(4, bool)))


def test_one_row_of_alive_applies_to_batch(hazard: Hazard) -> None:
    batch, alive = np.stack([SQUARE, SQUARE + 1]), np.array([True, False, True, True])
    rates = hazard.rates(batch, alive)
    np.testing.assert_array_equal(rates, hazard.rates(batch, [alive, alive]))
    assert (rates[:, 1] == 0).all()


def test_rates_do_not_change_arguments(hazard: Hazard) -> None:
    positions, alive = SQUARE.copy(), np.array([True, False, True, True])
    hazard.rates(positions, alive)
    np.testing.assert_array_equal(positions, SQUARE)
    assert alive.tolist() == [True, False, True, True]


@pytest.mark.parametrize("shape", [(2,), (4, 2), (3, 5, 2), (0, 2)])
def test_single_agent_rates_have_shape_of_points(hazard: Hazard, shape: tuple[int, ...]) -> None:
    assert hazard.single_agent_rates(np.ones(shape)).shape == shape[:-1]


SHAPES = [
    *(
        ("positions", shape)
        for shape in [(), (2,), (4, 3), (2, 4), (1, 2, 4, 2), (0, 2), (3, 0, 2)]
    ),
    *(("alive", shape) for shape in [(), (3,), (1, 4), (4, 1), (3, 4), (2, 1)]),
    *(("points", shape) for shape in [(), (3,), (4, 3)]),
]


@pytest.mark.parametrize(("key", "shape"), SHAPES)
def test_wrong_shape_is_refused(hazard: Hazard, key: str, shape: tuple[int, ...]) -> None:
    wrong, two = np.zeros(shape), np.stack([SQUARE] * 2)
    call, needed = {
        "positions": (lambda: hazard.rates(wrong), "(n, 2) or (B, n, 2), n >= 1"),
        "alive": (lambda: hazard.rates(two, wrong.astype(bool)), "(2, 4), as for positions"),
        "points": (lambda: hazard.single_agent_rates(wrong), "(..., 2)"),
    }[key]
    error = refused(HazardError, call)
    verb = "has" if key == "alive" else "have"
    assert str(error) == f"{key} {verb} shape {shape}; expected {needed}"
    assert (error.key, error.shape) == (key, shape)
    assert key != "alive" or error.expected == (2, 4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_positions_not_finite_are_refused(hazard: Hazard, value: float) -> None:
    state = SQUARE.copy()
    state[2, 1] = value
    alive = [True, True, False, True]  # not even those of the destroyed
    for call, arguments in ((hazard.rates, (state, alive)), (hazard.single_agent_rates, (state,))):
        error = refused(HazardError, call, *arguments)
        assert str(error) == "positions hold NaN or infinity"
        assert error.key == "positions"


def test_rates_far_away_vanish_without_warnings(hazard: Hazard) -> None:
    rates = hazard.rates([[1e200, 0], [-1e200, 1e-200], [1e8, 0]])
    assert rates[:2].tolist() == [0, 0]
    assert 0 < rates[2] < 1e-15


# --- parameters


ABOVE_ZERO = "allowed: a finite number above zero"
PARAMETERS: list[tuple[str, Any, str, dict[str, Any]]] = [
    ("radars", (), "radars are empty; expected (k, 2), k >= 1", {}),
    ("radars", (1.0, 2.0), "radars have shape (2,); expected (k, 2)", {"shape": (2,)}),
    ("radars", ((1.0, 2.0, 3.0),), "radars have shape (1, 3); expected (k, 2)", {"shape": (1, 3)}),
    ("radars", ((1.0, 2.0), (3.0,)), "expected k pairs (x, y) of numbers", {}),
    ("radars", (("a", "b"),), "expected k pairs (x, y) of numbers", {}),
    ("radars", "here", "expected k pairs (x, y) of numbers", {"value": "'here'"}),
    (
        "radars",
        ((0.0, np.inf),),
        "radars must be finite; got ((0.0, inf),)",
        {"value": ((0.0, np.inf),)},
    ),
    ("radars", ((0.0, np.nan),), "radars must be finite; got ((0.0, nan),)", {}),
    (
        "strengths",
        (1.0,),
        "1 strength for 2 radars; expected one each",
        {"value": (1.0,), "expected": 2},
    ),
    (
        "strengths",
        (1.0, 0.0),
        "strengths must be finite and above zero; got (1.0, 0.0)",
        {"value": (1.0, 0.0)},
    ),
    ("strengths", (1.0, np.inf), "strengths must be finite and above zero", {}),
    ("alpha_1", 0.0, f"alpha_1 = 0.0; {ABOVE_ZERO}", {"value": 0.0}),
    ("alpha_1", np.nan, f"alpha_1 = nan; {ABOVE_ZERO}", {}),
    ("alpha_1", "4", f"alpha_1 = '4'; {ABOVE_ZERO}", {}),
    ("alpha_2", -1.0, "alpha_2 = -1.0; allowed: zero or above, finite", {"value": -1.0}),
    ("alpha_2", None, "alpha_2 = None; allowed: zero or above, finite", {}),
    ("alpha_3", -1.0, f"alpha_3 = -1.0; {ABOVE_ZERO}", {"value": -1.0}),
    ("beta_1", 0.0, f"beta_1 = 0.0; {ABOVE_ZERO}", {"value": 0.0}),
    ("beta_2", np.inf, f"beta_2 = inf; {ABOVE_ZERO}", {"value": np.inf}),
    *(
        ("core_radius", radius, "allowed: a finite number", {})
        for radius in (0.0, -1.0, np.inf, "wide")
    ),
]


@pytest.mark.parametrize(("key", "value", "words", "values"), PARAMETERS)
def test_wrong_parameter_names_allowed_values(
    key: str, value: Any, words: str, values: dict[str, Any]
) -> None:
    error = refused(HazardError, lambda: SaturationCollision(**{"radars": RADARS, key: value}))
    assert words in str(error)
    assert key != "core_radius" or str(error).startswith("core_radius = ")
    assert {name: getattr(error, name) for name in ("key", *values)} == {"key": key, **values}


def test_zero_saturation_is_allowed() -> None:
    rates = Saturation(RADARS, alpha_2=0.0).rates(SQUARE)
    np.testing.assert_allclose(rates, Saturation(RADARS, alpha_2=0.0).single_agent_rates(SQUARE))


def test_hazard_error_is_value_error() -> None:
    assert issubclass(HazardError, CasswarmError)
    assert issubclass(HazardError, ValueError)


def test_radars_and_strengths_are_arrays() -> None:
    hazard = Saturation(RADARS, strengths=(2.0, 3.0))
    assert hazard.radar_positions.tolist() == [list(radar) for radar in RADARS]
    assert hazard.radar_strengths.tolist() == [2, 3]
    assert Saturation(RADARS).radar_strengths.tolist() == [1, 1]


# --- equality, copies, pickles


def test_hazards_of_equal_parameters_are_equal() -> None:
    lists = Saturation([list(radar) for radar in RADARS], [1, 2])  # type: ignore[arg-type]
    arrays = Saturation(np.array(RADARS), np.array([1, 2]))  # type: ignore[arg-type]
    assert lists == arrays == Saturation(RADARS, (1.0, 2.0))
    assert hash(lists) == hash(arrays) == hash(Saturation(RADARS, (1.0, 2.0)))


def test_hazards_differ_by_kind_and_by_every_parameter(hazard: Saturation) -> None:
    assert hazard != SaturationCollision(RADARS)
    for other in (
        Saturation(RADARS[::-1]),
        Saturation(RADARS, (1.0, 2.0)),
        Saturation(RADARS, alpha_1=5.0),
        Saturation(RADARS, alpha_2=5.0),
        Saturation(RADARS, alpha_3=5.0),
    ):
        assert other != hazard


def test_hazards_are_immutable(hazard: Saturation) -> None:
    with pytest.raises(FrozenInstanceError):
        hazard.alpha_1 = 1.0  # type: ignore[misc]


# --- kernels of a user's own


@dataclass(frozen=True)
class Counting(KernelHazard):
    """Kernels that are plain numbers: S = 2 k, D = number of the living, C = 3 others."""

    def source(self, squared_distance: Any) -> Any:  # noqa: ARG002
        return 2.0

    def density(self, squared_distance: Any) -> Any:  # noqa: ARG002
        return 1.0

    def collision(self, squared_distance: Any) -> Any:  # noqa: ARG002
        return 3.0

    def combine(self, source: Any, density: Any, collision: Any) -> Any:
        return source + 10 * density + 100 * collision


@dataclass(frozen=True)
class Branching(Counting):
    """A source that ends at distance 1, and logarithms that only exist above zero."""

    def source(self, squared_distance: Any) -> Any:
        near = squared_distance < 1
        return ca.if_else(near, -ca.log(squared_distance), 0)

    def density(self, squared_distance: Any) -> Any:
        return ca.exp(-squared_distance)

    def collision(self, squared_distance: Any) -> Any:
        return ca.if_else(squared_distance > 0, 1 / squared_distance, 0)


class Constant(Counting):
    """A rate that depends on nothing."""

    def combine(self, source, density, collision):
        del density, collision
        return 0 * source + 5


def test_rates_may_be_constants() -> None:
    hazard = Constant(RADARS, (1.0, 2.0))
    assert hazard.rates(SQUARE, np.array([1, 0, 1, 1])).tolist() == [5, 0, 5, 5]
    assert hazard.single_agent_rates(SQUARE).tolist() == [5] * 4
    assert hazard.rates(np.empty((0, 4, 2)), np.empty((0, 4))).shape == (0, 4)


def test_kernels_may_be_constants() -> None:
    hazard, alive = Counting(RADARS, (1.0, 2.0)), np.array([1, 0, 1, 1])
    expected = [6 + 10 * 3 + 100 * 6, 6 + 10 * 3 + 100 * 9] + [6 + 10 * 3 + 100 * 6] * 2
    rates = symbolic(hazard, 4)(SQUARE.T, alive)[0]
    assert np.asarray(rates)[0].tolist() == expected
    assert hazard.rates(SQUARE, alive).tolist() == [expected[0], 0, *expected[2:]]
    assert hazard.single_agent_rates(SQUARE).tolist() == [16] * 4
    points = ca.MX.sym("points", 2, 4)
    lone = ca.Function("lone", [points], [hazard.single_agent_expression(points)])(SQUARE.T)
    assert np.asarray(lone)[0].tolist() == [16] * 4


def test_kernels_may_branch_without_warnings() -> None:
    hazard, alive = Branching(((0.5, 0.0),)), np.array([1, 1, 0, 1])
    rates = np.asarray(symbolic(hazard, 4)(SQUARE.T, alive)[0])[0]
    np.testing.assert_allclose(hazard.rates(SQUARE, alive)[[0, 1, 3]], rates[[0, 1, 3]], rtol=1e-14)
    density, source = 1 + 2 * np.exp(-1), -np.log(0.25)
    assert rates[0] == pytest.approx(source + 10 * density + 100 * 2)


def test_invalid_rates_are_refused_with_position() -> None:
    hazard = Branching(((0.5, 0.0),))
    # -log(0) at the radar
    assert str(refused(HazardError, hazard.rates, [[3.0, 3.0], [0.5, 0.0]])) == (
        "Branching(radars=((0.5, 0.0),), strengths=None, core_radius=0.01) gives the rate inf "
        "for member 1 at (0.5, 0); rates must be finite and not negative"
    )
    assert hazard.rates([[3.0, 3.0], [0.5, 0.0]], [True, False]).tolist() == [10, 0]

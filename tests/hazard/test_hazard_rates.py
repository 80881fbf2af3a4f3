"""The paper's rates: values, derivatives, what must not change them, and their compiled form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hazard_cases import Array, State, by_loops, states, symbolic
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import patrolled

import casswarm as csw
from casswarm._util.numbers import CORE_RADIUS
from casswarm.hazard import Hazard, Saturation, SaturationCollision, compiled_rates, regular
from casswarm.hazard.codegen import differentiated_kernels

RADARS = ((4.4, 4.6), (4.5, 3.0))
KINDS = [Saturation, SaturationCollision]

Body = Callable[..., None]


def random(examples: int) -> Callable[[Body], Body]:
    return settings(max_examples=examples, deadline=None, derandomize=True)


def rates_of(state: State) -> Array:
    return state.hazard.rates(state.positions, state.alive)


# --- values


@random(200)
@given(state=states())
def test_rates_equal_sums_of_the_paper(state: State) -> None:
    expected = np.where(state.alive, by_loops(state.hazard, state.positions, state.alive), 0)
    np.testing.assert_allclose(rates_of(state), expected, rtol=1e-12)


@random(50)
@given(state=states())
def test_expression_equals_sums_for_destroyed_too(state: State) -> None:
    rates = symbolic(state.hazard, len(state.alive))(state.positions.T, state.alive)[0]
    expected = by_loops(state.hazard, state.positions, state.alive)
    np.testing.assert_allclose(np.asarray(rates)[0], expected, rtol=1e-12)


def test_rates_of_two_members_equal_hand_calculation() -> None:
    hazard = SaturationCollision(((0, 0), (3, 4)), (1.0, 2.0), 6.0, 2.0, 3.0, beta_1=2.0, beta_2=3)
    # distances: members 1; radars 1 and sqrt(20), 2 and sqrt(17); h = 1 / 4, density 5 / 4
    saturated = 6 / (1 + 2 * 5 / 4)
    expected = [saturated * (1 + 2 / 20) + 2**3, saturated * (1 / 4 + 2 / 17) + 2**3]
    np.testing.assert_allclose(hazard.rates([[1, 0], [2, 0]]), expected, rtol=1e-14)
    alone = [6 / (1 + 2) * (1 + 2 / 20), 0]
    np.testing.assert_allclose(hazard.rates([[1, 0], [2, 0]], [True, False]), alone, rtol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_rate_of_one_member_equals_single_agent_rate(kind: type[Saturation]) -> None:
    hazard = kind(RADARS, strengths=(1.0, 3.0))
    points = np.random.default_rng(0).uniform(0, 8, (3, 7, 2))
    squares = [((points - radar) ** 2).sum(axis=-1) for radar in RADARS]
    expected = hazard.alpha_1 / (1 + hazard.alpha_2) * (1 / squares[0] + 3 / squares[1])
    np.testing.assert_allclose(hazard.single_agent_rates(points), expected, rtol=1e-13)
    np.testing.assert_array_equal(
        hazard.rates(points[0, :1]), hazard.single_agent_rates(points[0, :1])
    )
    flat = ca.MX.sym("points", 2, 21)
    lone = ca.Function("lone", [flat], [hazard.single_agent_expression(flat)])(
        points.reshape(-1, 2).T
    )
    np.testing.assert_allclose(np.asarray(lone)[0], expected.ravel(), rtol=1e-13)


# --- near zero distance


@pytest.mark.parametrize("radius", [CORE_RADIUS, 1e-5, 30.0])
def test_distances_above_core_radius_are_unchanged(radius: float) -> None:
    squared = radius**2 * np.concatenate([[1.0], 1 + np.geomspace(1e-12, 1e9, 1000)])
    kept = [float(regular(value, radius)) for value in squared]
    assert kept == squared.tolist()
    assert float(regular(0.0, radius)) == pytest.approx(radius**2 / 2)


@pytest.mark.parametrize("kind", KINDS)
def test_core_radius_is_a_parameter_of_the_compiled_code(kind: type[Saturation]) -> None:
    (source, narrow), (same, wide) = (
        differentiated_kernels(kind(RADARS, core_radius=radius)) for radius in (0.01, 0.5)
    )
    assert source == same
    assert set(wide) - set(narrow) == {0.5}


@pytest.mark.parametrize("kind", KINDS)
def test_rates_within_core_radius_equal_expression(kind: type[Saturation]) -> None:
    hazard = kind(RADARS, core_radius=0.7)
    positions = np.array([[4.3, 4.5], [4.5, 4.8], [4.6, 3.1]])
    x = ca.MX.sym("x", 2, 3)
    rates = ca.Function("rates", [x], [hazard.expression(x, ca.DM.ones(1, 3))])(positions.T)
    np.testing.assert_allclose(hazard.rates(positions), np.asarray(rates)[0], rtol=1e-13)
    assert (hazard.rates(positions) < 0.5 * kind(RADARS).rates(positions)).all()


def test_regularised_distances_are_smooth_and_positive() -> None:
    core = CORE_RADIUS**2
    s = ca.SX.sym("s")
    slope = ca.Function("slope", [s], [regular(s), ca.gradient(regular(s), s)])
    squared = np.linspace(0, 2 * core, 2001)
    value, derivative = (np.asarray(part)[0] for part in slope(squared[None]))
    np.testing.assert_allclose(derivative, np.minimum(squared / core, 1), atol=1e-12)  # continuous
    np.testing.assert_allclose(value[:1001], (core + squared[:1001] ** 2 / core) / 2, rtol=1e-14)
    assert value.min() == pytest.approx(core / 2, rel=1e-14)
    assert (np.diff(value) >= 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_rate_at_radar_is_large_and_finite(kind: type[Saturation]) -> None:
    hazard = kind(((1, 2), (1, 3)))
    rates = hazard.rates([[1, 2], [1, 2 + 1e-9], [1, 2.01]])
    assert np.isfinite(rates).all()
    peak = hazard.alpha_1 / (1 + hazard.alpha_2) * (2 / CORE_RADIUS**2 + 1)
    np.testing.assert_allclose(hazard.single_agent_rates([1, 2]), peak, rtol=1e-12)


def test_rate_of_touching_members_is_large_and_finite() -> None:
    hazard = SaturationCollision(((100, 0),), beta_1=0.2, beta_2=6)
    together = (0.2**2 / (CORE_RADIUS**2 / 2)) ** 3
    np.testing.assert_allclose(hazard.rates([[0, 0], [0, 0]]), together, rtol=1e-9)


# --- derivatives


@random(40)
@given(state=states(n_max=4))
def test_jacobian_equals_differences_of_rates(state: State) -> None:
    n = len(state.alive)
    jacobian = np.asarray(symbolic(state.hazard, n)(state.positions.T, state.alive)[1])
    step = 1e-6
    moves = step * np.eye(2 * n).reshape(2 * n, n, 2)
    ahead = state.hazard.rates(state.positions + moves, state.alive)
    behind = state.hazard.rates(state.positions - moves, state.alive)
    differences = ((ahead - behind) / (2 * step)).T
    scale = 1 + np.abs(jacobian).max()
    np.testing.assert_allclose(
        jacobian[state.alive] / scale, differences[state.alive] / scale, atol=2e-6
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("apart", [0.0, 1e-160, 1e-12, CORE_RADIUS, CORE_RADIUS / 2])
def test_derivatives_are_finite_at_contact(kind: type[Saturation], apart: float) -> None:
    hazard = kind(RADARS)
    x = np.array([[0, 0], [apart, 0], RADARS[0], np.add(RADARS[0], [0, apart]), [1, 1], [1, 1]])
    for alive in (np.ones(6), np.array([1, 0, 0, 1, 1, 1])):
        for part in symbolic(hazard, 6)(x.T, alive):
            assert np.isfinite(np.asarray(part)).all()


def test_gradient_at_radar_is_zero() -> None:
    point = ca.MX.sym("point", 2, 1)
    rate = Saturation(RADARS[:1]).single_agent_expression(point)
    gradient = ca.Function("gradient", [point], [ca.gradient(rate, point)])
    assert np.asarray(gradient(RADARS[0])).ravel().tolist() == [0, 0]
    assert float(gradient([4.3, 4.6])[0]) > 0  # towards the radar it grows


# --- what must not change them


@random(100)
@given(state=states(), seed=st.integers(0, 99))
def test_rates_are_independent_of_member_order(state: State, seed: int) -> None:
    order = np.random.default_rng(seed).permutation(len(state.alive))
    hazard = state.hazard.of_members(order)
    permuted = State(hazard, state.positions[order], state.alive[order])
    np.testing.assert_allclose(rates_of(permuted), rates_of(state)[order], rtol=1e-13)


@pytest.mark.slow
@random(100)
@given(state=states(), shift=st.tuples(st.integers(-50, 50), st.integers(-50, 50)))
def test_rates_depend_on_relative_positions_only(state: State, shift: tuple[int, int]) -> None:
    def moved(points: object) -> Array:  # a quarter turn and a shift, both without rounding
        return np.asarray(points)[..., ::-1] * [-1, 1] + shift

    radars = tuple(map(tuple, moved(state.hazard.radars)))
    other = replace(state, hazard=replace(state.hazard, radars=radars))
    np.testing.assert_array_equal(
        rates_of(replace(other, positions=moved(state.positions))), rates_of(state)
    )


@random(100)
@given(state=states(), seed=st.integers(0, 99))
def test_rates_are_independent_of_destroyed_positions(state: State, seed: int) -> None:
    anywhere = np.random.default_rng(seed).uniform(-5, 5, state.positions.shape)
    anywhere[::2] = state.positions[0]  # on top of a living member, perhaps
    moved = np.where(state.alive[:, None], state.positions, anywhere)
    rates = state.hazard.rates(moved, state.alive)
    np.testing.assert_array_equal(rates, rates_of(state))
    assert (rates[~state.alive] == 0).all()
    if state.alive.any():
        hazard = state.hazard.of_members(np.flatnonzero(state.alive))
        survivors = hazard.rates(state.positions[state.alive])
        np.testing.assert_allclose(rates[state.alive], survivors, rtol=1e-13)


@random(100)
@given(state=states())
def test_rates_are_positive_for_the_living_only(state: State) -> None:
    np.testing.assert_array_equal(rates_of(state) > 0, state.alive)


@random(100)
@given(state=states(), factor=st.floats(0.1, 10))
def test_saturation_rates_are_proportional_to_strength(state: State, factor: float) -> None:
    hazard = Saturation(state.hazard.radars, state.hazard.strengths)
    strengths = factor * hazard.radar_strengths
    stronger = replace(hazard, strengths=tuple(strengths))
    np.testing.assert_allclose(
        stronger.rates(state.positions, state.alive),
        factor * hazard.rates(state.positions, state.alive),
        rtol=1e-13,
    )


# --- what must change them


@random(100)
@given(state=states())
def test_destruction_raises_saturation_rates_of_others(state: State) -> None:
    hazard = Saturation(state.hazard.radars)
    before = hazard.rates(state.positions, state.alive)
    for fallen in np.flatnonzero(state.alive):
        left = state.alive & (np.arange(len(state.alive)) != fallen)
        assert (hazard.rates(state.positions, left)[left] > before[left]).all()


def test_near_member_lowers_saturation_rates() -> None:
    hazard = Saturation(RADARS)
    others = np.array([[1.0, 1.0], [0.6, 1.2]])
    alone = hazard.rates(others)
    distances = [3.0, 1.0, 0.5, 0.1, 0.01, 0.0]
    rates = np.array([hazard.rates([*others, [1 - d, 1]])[0] for d in distances])
    assert (rates < alone[0]).all()
    assert (np.diff(rates) < 0).all()


def test_collisions_raise_rates_of_near_members_only() -> None:
    state = [[0, 0], [0.1, 0], [3, 0]]
    added = SaturationCollision(RADARS).rates(state) - Saturation(RADARS).rates(state)
    np.testing.assert_allclose(added, [2**6, 2**6, 0], rtol=1e-6, atol=1e-6)


# --- batches


def hazards() -> list[Hazard]:
    return [Saturation(RADARS), SaturationCollision(RADARS, strengths=(1.0, 2.5))]


@pytest.mark.parametrize("hazard", hazards(), ids=repr)
@pytest.mark.parametrize("n", [1, 2, 5, 8, 9, 17])
@pytest.mark.parametrize("pairs", [1, 100, 1 << 19])
def test_rates_of_batch_equal_single_states(
    hazard: Hazard, n: int, pairs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(n)
    states, alive = rng.normal(size=(23, n, 2)), rng.random((23, n)) < 0.7
    singles = np.array([hazard.rates(x, a) for x, a in zip(states, alive, strict=True)])
    monkeypatch.setattr("casswarm.hazard.array_rates._CHUNK_PAIRS", pairs)
    for size in (1, 2, 7, 23):
        for start in range(0, 23, size):
            part = slice(start, start + size)
            np.testing.assert_array_equal(hazard.rates(states[part], alive[part]), singles[part])


# --- compiled rates


NEAR = [(1.0, 0.5), (-0.5, 2.0), (0.0, 0.0)]


class Foggy(csw.Saturation):
    """Rates that decay as an exponential."""

    def source(self, squared_distance: Any) -> Any:
        import casadi as ca

        return ca.exp(-squared_distance)


HAZARDS = [
    csw.Saturation(NEAR),
    csw.Saturation(NEAR, strengths=(1.0, 0.2, 3.0), alpha_1=0.7, alpha_2=0.0),
    csw.SaturationCollision(NEAR[:1]),
    Foggy(NEAR),
]


def rates(hazard: csw.Hazard, positions: Any, alive: Any) -> Any:
    compiled = compiled_rates(hazard, alive.shape[1])
    found = np.full(alive.shape, np.nan)
    assert compiled(positions, alive, found)
    return found


@pytest.mark.parametrize("hazard", HAZARDS, ids=lambda hazard: type(hazard).__name__)
@given(seed=st.integers(0, 2**32), n=st.integers(1, 7), batch=st.sampled_from([1, 5, 64, 67]))
def test_compiled_rates_equal_rates(hazard: csw.Hazard, seed: int, n: int, batch: int) -> None:
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, n)) < 0.7
    positions = np.where(alive[..., None], rng.normal(size=(batch, n, 2)), 0.0)
    found = rates(hazard, positions, alive)
    np.testing.assert_allclose(found, hazard.rates(positions, alive), rtol=1e-12)
    assert not found[~alive].any()


def test_compiled_rates_do_not_depend_on_the_states_beside() -> None:
    rng = np.random.default_rng(0)
    positions, alive = rng.normal(size=(20, 5, 2)), rng.random((20, 5)) < 0.8
    together = rates(HAZARDS[0], positions, alive)
    for k in range(20):
        alone = rates(HAZARDS[0], positions[k : k + 1].copy(), alive[k : k + 1].copy())
        np.testing.assert_array_equal(together[k], alone[0])


def test_compiled_rates_of_custom_hazard_are_none() -> None:
    assert compiled_rates(csw.CustomHazard(patrolled), 3) is None

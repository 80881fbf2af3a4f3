"""Observations: known answers, invariances, and independence of the destroyed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_scenarios import small

import casswarm as csw
from casswarm.policies import Observation

TWO = small([(0.0, 0.0), (3.0, 4.0)], (3.0, 0.0), [(1.0, 2.0)], 10)


def test_observation_of_two_members_is_as_documented() -> None:
    observation = Observation.from_scenario(TWO, "float64")
    assert observation.length == 4.0
    assert observation.size == 6 + 2 + 5
    positions = np.array([[[0.0, 1.0], [2.0, 4.0]]])
    velocities = np.array([[[2.0, 0.5], [-1.0, 0.0]]])
    both = observation(4, positions, velocities, np.array([[True, True]]))
    other = [1.0, 0.5, 0.75, -0.5, 0.0]
    np.testing.assert_allclose(both[0, 0], [1, 0.6, -0.75, 0.25, 1, 0.25, 0.25, 0.25, *other])
    one = observation(4, positions, velocities, np.array([[True, False]]))
    np.testing.assert_allclose(one[0, 0], [1, 0.6, -0.75, 0.25, 1, 0.25, 0.25, 0.25, *[0.0] * 5])
    assert not one[0, 1].any()


def test_slices_name_every_number_once() -> None:
    observation = Observation.from_scenario(csw.load_scenario("alley"))
    numbers = [k for part in observation.slices.values() for k in range(observation.size)[part]]
    assert numbers == list(range(observation.size))


@given(seed=st.integers(0, 2**32), scale=st.floats(0.01, 100.0), shift=st.floats(-50.0, 50.0))
def test_observation_is_invariant_to_units_and_origin(
    seed: int, scale: float, shift: float
) -> None:
    rng = np.random.default_rng(seed)
    positions, velocities = rng.normal(size=(2, 6, 2, 2))
    alive = rng.random((6, 2)) < 0.8

    def moved(points: Any) -> Any:
        return scale * (np.array(points) + shift)

    other = TWO.with_values(
        {
            "swarm.positions": moved(TWO.positions).tolist(),
            "swarm.v_max": scale * TWO.swarm.v_max,
            "swarm.a_max": scale**2 * TWO.swarm.a_max,
            "target.center": moved(TWO.target.center).tolist(),
            "target.radius": scale * TWO.target.radius,
            "hazard.radars": moved([(1.0, 2.0)]).tolist(),
        }
    )
    steps = rng.integers(0, 10, 6)
    given_ = Observation.from_scenario(TWO, "float64")(steps, positions, velocities, alive)
    found = Observation.from_scenario(other, "float64")(
        steps, moved(positions), scale * velocities, alive
    )
    np.testing.assert_allclose(found, given_, atol=1e-9)


def test_single_precision_is_the_rounded_double_precision() -> None:
    rng = np.random.default_rng(1)
    state = rng.normal(size=(5, 2, 2)), rng.normal(size=(5, 2, 2)), np.ones((5, 2), bool)
    double = Observation.from_scenario(TWO, float)(0, *state)
    single = Observation.from_scenario(TWO, np.float32)(0, *state)
    assert single.dtype == np.float32
    np.testing.assert_array_equal(single, double.astype(np.float32))


@pytest.mark.parametrize("dtype", ["int32", "nonsense", None, "float16"])
def test_other_dtypes_raise(dtype: Any) -> None:
    if dtype is None:  # NumPy's default is float64
        assert Observation.from_scenario(TWO, dtype).dtype == "float64"
        return
    with pytest.raises(csw.PolicyError, match="allowed: float32 or float64"):
        Observation.from_scenario(TWO, dtype)

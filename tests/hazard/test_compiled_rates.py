"""Compiled rates agree with those of NumPy, for the paper's hazards and for others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_scenarios import patrolled

import casswarm as csw
from casswarm.hazard import compiled_rates

RADARS = [(1.0, 0.5), (-0.5, 2.0), (0.0, 0.0)]


class Foggy(csw.Saturation):
    """Rates that decay as an exponential."""

    def source(self, squared_distance: Any) -> Any:
        import casadi as ca

        return ca.exp(-squared_distance)


HAZARDS = [
    csw.Saturation(RADARS),
    csw.Saturation(RADARS, strengths=(1.0, 0.2, 3.0), alpha_1=0.7, alpha_2=0.0),
    csw.SaturationCollision(RADARS[:1]),
    Foggy(RADARS),
]


def rates(hazard: csw.Hazard, positions: Any, alive: Any) -> Any:
    compiled = compiled_rates(hazard, alive.shape[1])
    assert compiled is not None
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

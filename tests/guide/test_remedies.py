"""Scenarios without a path: every change that is named is enough alone, and hardly less is."""

from __future__ import annotations

import pytest
from small_scenarios import MEMBER, small

import casswarm as csw
from casswarm.guide.remedies import remedies

RADAR = [(1.5, 0.8)]
SLOW = {"swarm__velocity": [0.0, 0.0], "guide__a_max": 0.0005}


def scenario(steps=6, target=(3.0, 0.0), positions=MEMBER, **values):
    return small(positions, target, RADAR, steps, **values)


CASES = {
    "away": scenario(swarm__velocity=[-2.0, 0.0]),
    "away, disc": scenario(swarm__velocity=[-2.0, 0.0], swarm__speed="disc"),
    "slow": scenario(**SLOW),
    "slow, disc": scenario(swarm__speed="disc", **SLOW),
    "across": scenario(swarm__velocity=[0.0, 2.0], guide__a_max=0.05),
    "margin": scenario(4, (3.0, 0.0), guide__margin=0.4),
    "swarm": scenario(5, (3.7, 0.0), [(0.0, 0.0), (0.2, 0.1)], formation__rho=0.04),
}


def arrives(changed) -> bool:
    try:
        return csw.plan(changed, certify=False).arrives
    except csw.PlanningError:
        return False


QUICK = ("margin", "swarm")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in CASES]
)
def test_every_change_is_enough_and_little_less_is_not(name) -> None:
    impossible = CASES[name]
    with pytest.raises(csw.PlanningError, match="one change is enough") as caught:
        csw.plan(impossible, certify=False)
    found = caught.value.remedies
    assert found == remedies(impossible)
    assert len(found) >= 2
    for remedy in found:
        assert arrives(impossible.with_values({remedy.key: remedy.enough})), remedy
        assert str(remedy) in str(caught.value)
        if isinstance(remedy.enough, float) and remedy.key != "time.t_f":
            less = remedy.value + 0.8 * (remedy.enough - remedy.value)
            assert not arrives(impossible.with_values({remedy.key: less})), remedy


def test_smallest_acceleration_from_rest_is_that_of_a_straight_line() -> None:
    """Velocities 0, a, ..., 5 a after a first step that only swarm.a_max limits."""
    (only,) = (r for r in remedies(CASES["slow"]) if r.key == "guide.a_max")
    first, dt, way = 0.5**0.5, 0.33, 2.5
    change = (way / dt - 6 * first) / 15
    assert only.enough == pytest.approx(change**2, rel=5e-3)
    assert only.enough >= change**2 * (1 - 1e-5)


def test_possible_scenarios_need_no_change_and_long_ones_get_no_answer() -> None:
    assert remedies(scenario(8)) == ()
    assert remedies(scenario(500, **SLOW)) is None


def test_horizon_has_the_number_of_steps_that_is_enough() -> None:
    """A path of another length need not exist where the guide arrives at the end of the horizon."""
    fixed = CASES["margin"].with_values({"guide.arrival": "horizon"})
    (horizon,) = (r for r in remedies(fixed) if r.key == "time.t_f")
    assert fixed.with_values({"time.t_f": horizon.enough}).n_steps == 5
    assert arrives(fixed.with_values({"time.t_f": horizon.enough}))

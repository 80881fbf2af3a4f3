"""Radars as points: which cases have them, which move together, and what a movement keeps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_scenarios import small

import casswarm as csw
from casswarm.exploration.radar_points import radar_points, with_radar_at

BASE = small([(0.0, 0.0)], (6.0, 0.0), [(3.0, 2.0)], 20)


def with_cases(*cases, base=BASE, **values):
    """The scenario with cases, each a list of radars, or keys of its hazard."""
    tables = [case if isinstance(case, dict) else {"radars": case} for case in cases]
    return base.with_values({"hazard.case": tables, **values})


def clouds(scenario):
    """Positions of the radars by cloud."""
    found = {}
    for point in radar_points(scenario):
        found.setdefault(point.cloud, set()).add(point.position)
    return found


def moved(scenario, index, position):
    return scenario.with_values(with_radar_at(scenario, index, position))


@pytest.mark.parametrize("name", ["crossfire", "patrol", "blink"])
def test_radars_of_a_known_hazard_keep_their_order(name) -> None:
    scenario = csw.load_scenario(name)
    points = radar_points(scenario)
    assert tuple(point.position for point in points) == scenario.hazard_table.starts
    assert {point.cloud for point in points} == {None}
    assert {point.cases for point in points} == {(0,)}


def test_one_unknown_radar_is_a_cloud_and_others_are_not() -> None:
    scenario = csw.load_scenario("two-gaps")
    found = clouds(scenario)
    assert found.keys() == {None, 0}
    assert found[0] == {(5.0, -2.0), (5.0, 2.0)}
    (nine,) = clouds(csw.load_scenario("cloud")).values()
    assert len(nine) == 9


def test_independent_radars_are_clouds_of_their_own() -> None:
    a, b = [(3.0, 2.0), (3.0, 2.5)], [(4.0, -2.0), (4.5, -2.0)]
    product = with_cases(*([first, second] for first in a for second in b))
    assert clouds(product) == {0: set(a), 1: set(b)}
    paired = with_cases([a[0], b[0]], [a[1], b[1]])
    assert clouds(paired) == {0: set(a), 1: set(b)}


def test_radars_that_are_together_in_a_case_move_alone() -> None:
    lacking = [[(3.0, y) for y in (-2.0, 0.8, 2.0) if y != gap] for gap in (-2.0, 0.8, 2.0)]
    assert sorted(map(len, clouds(with_cases(*lacking)).values())) == [1, 1, 1]


def test_cloud_moves_as_one_and_keeps_the_rest() -> None:
    scenario = csw.load_scenario("two-gaps")
    index = next(k for k, p in enumerate(radar_points(scenario)) if p.position == (5.0, 2.0))
    after = moved(scenario, index, (5.5, 1.75))
    assert clouds(after)[0] == {(5.5, 1.75), (5.5, -2.25)}
    assert clouds(after)[None] == clouds(scenario)[None]
    assert [case.weight for case in after.cases] == [0.5, 0.5]
    common = next(k for k, p in enumerate(radar_points(scenario)) if p.position == (5.0, 0.0))
    after = moved(scenario, common, (4.0, 0.5))
    assert all((4.0, 0.5) in case.scenario.hazard_table.radars for case in after.cases)
    assert clouds(after)[0] == clouds(scenario)[0]


def test_inherited_radars_and_equal_ones_move_where_they_are_written() -> None:
    inherited = with_cases({}, [(3.0, -2.0), (3.0, -2.0)])  # two at the same place
    points = radar_points(inherited)
    assert [(p.position, p.cases) for p in points] == [
        ((3.0, 2.0), (0,)),
        ((3.0, -2.0), (1,)),
        ((3.0, -2.0), (1,)),
    ]
    assert [point.cloud for point in points] == [0, 0, 1]
    after = moved(inherited, 0, (3.5, 2.0))
    assert after.hazard_table.radars == ((3.5, 2.0),)
    assert after.hazard_table.case[1].radars == ((3.5, -2.0), (3.0, -2.0))
    strengths = with_cases({"strengths": [1.0]}, {"strengths": [2.0]})
    assert [point.cloud for point in radar_points(strengths)] == [None]
    assert moved(strengths, 0, (3.0, 1.0)).hazard_table.radars == ((3.0, 1.0),)


def test_paths_of_radars_move_with_them() -> None:
    tables = [{"position": [3.0, y], "velocity": [0.0, -y / 9]} for y in (2.0, -2.0)]
    scenario = with_cases(*({"radar": [table]} for table in tables))
    ahead, *both = radar_points(scenario)
    assert (ahead.position, ahead.cloud) == ((3.0, 2.0), None)  # that of [hazard], at rest
    assert [point.cloud for point in both] == [0, 0]
    after = moved(scenario, 1, (3.5, 1.5))
    for before, case, shift in zip(scenario.cases, after.cases, ((0.5, -0.5),) * 2, strict=True):
        (old,), (new,) = (each.scenario.hazard_table.radar for each in (before, case))
        for time in (0.0, 2.0):
            moves = np.subtract(new.track.position_at(time), old.track.position_at(time))
            np.testing.assert_allclose(moves, shift, atol=1e-12)


@pytest.mark.slow
@given(st.integers(0, 8), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_moved_there_and_back_is_the_same_hazard(index, dx, dy) -> None:
    scenario = csw.load_scenario("cloud")
    x, y = radar_points(scenario)[index].position
    there = moved(scenario, index, (x + dx, y + dy))
    offsets = [
        np.subtract(p.position, q.position)
        for p, q in zip(radar_points(there), radar_points(scenario), strict=True)
    ]
    np.testing.assert_allclose(offsets, [[dx, dy]] * 9, atol=1e-12)
    back = moved(there, index, (x, y))
    places = [[p.position for p in radar_points(each)] for each in (back, scenario)]
    np.testing.assert_allclose(*places, atol=1e-12)


def test_impossible_places_are_refused_by_the_key_of_the_case() -> None:
    scenario = csw.load_scenario("cloud")
    with pytest.raises(csw.ScenarioError, match=r"on hazard\.case\[4\]\.radars\[0\]"):
        moved(scenario, 4, (0.0, 0.0))
    with pytest.raises(csw.ScenarioError, match=r"hazard\.case\[0\]\.radars\[0\]"):
        moved(scenario, 0, (float("nan"), 0.0))
    with pytest.raises(IndexError):
        moved(scenario, 9, (0.0, 0.0))

"""Close-ups of formations: who leads, who is lost, and how well the swarm protects."""

from __future__ import annotations

import numpy as np
import pytest
from figure_cases import GUIDE, SCENARIO, TRACE, trace
from matplotlib.axes import Axes

from casswarm import Hazard
from casswarm.chain.trajectories import RunTrajectory
from casswarm.figures import formation_chart
from casswarm.figures.closeups import additional_agent_rates, follows, leader_at, relative_rates
from casswarm.figures.formations import representative_steps


def signs(axes: Axes, marker: str) -> list[tuple[float, float]]:
    return [
        (float(line.get_xdata()[0]), float(line.get_ydata()[0]))
        for line in axes.get_lines()
        if line.get_marker() == marker
    ]


def test_panels_show_who_leads_who_lives_and_who_was_lost() -> None:
    fig = formation_chart(SCENARIO, TRACE, GUIDE, steps=[0, 2, 3], corridors=True)
    first, second, third = fig.axes[:3]
    assert [a.get_title() for a in (first, second, third)] == [
        "step 0: 3 of 3 alive",
        "step 2: 2 of 3 alive",
        "step 3: 2 of 3 alive",
    ]
    assert signs(first, "*") == [(0.3, 0.2)]  # member 2 leads
    assert len(signs(first, "o")) == 2
    assert not signs(first, "X")
    np.testing.assert_allclose(signs(second, "X"), [TRACE.positions[2, 1] - GUIDE.positions[2]])
    assert signs(second, "*") == [(0.0, 0.0)]  # then member 1
    assert not signs(third, "X")  # lost before
    words = [text.get_text() for text in fig.legends[0].get_texts()]
    assert words == ["leads", "alive", "lost in this step", "guide", "corridor"]


def test_without_leaders_and_guide_the_legend_does_not_speak_of_them() -> None:
    nobody = RunTrajectory(TRACE.positions, TRACE.alive, np.full(3, -1))
    fig = formation_chart(SCENARIO, nobody)
    words = [text.get_text() for text in fig.legends[0].get_texts()]
    assert words == ["alive", "lost in this step"]


def test_steps_out_of_the_run_are_refused() -> None:
    with pytest.raises(ValueError, match="allowed: from 0 to 3"):
        formation_chart(SCENARIO, TRACE, GUIDE, steps=[4])


def test_rates_of_one_more_member_are_those_that_it_would_have(hazard: Hazard) -> None:
    positions, alive = TRACE.positions[2], TRACE.alive[2]
    places = np.array([[[0.3, 0.1], [1.2, -0.4]], [[2.0, 1.0], [-1.0, 0.0]]])
    found = additional_agent_rates(hazard, places, positions, alive)
    for index in np.ndindex(2, 2):
        four = np.vstack([positions, places[index]])
        expected = hazard.rates(four, np.append(alive, True))[3]
        assert found[index] == pytest.approx(expected, rel=1e-12)


@pytest.fixture
def hazard() -> Hazard:
    return SCENARIO.hazard


def test_a_lone_member_is_not_protected_and_a_swarm_protects(hazard: Hazard) -> None:
    positions = TRACE.positions[1]
    here = positions.mean(axis=0)[None]
    assert relative_rates(hazard, here, positions, np.zeros(3, bool))[0] == pytest.approx(1)
    all_three = relative_rates(hazard, here, positions, np.ones(3, bool))[0]
    two = relative_rates(hazard, here, positions, TRACE.alive[2])[0]
    assert 0 < all_three < two < 1


def test_telling_steps_are_ends_losses_and_what_lies_between() -> None:
    assert representative_steps(TRACE, 8) == [0, 1, 2, 3]
    alive = np.ones((31, 3), bool)
    alive[17:, 0] = False
    alive[20:, 1] = False
    long = RunTrajectory(np.zeros((31, 3, 2)), alive, np.full(30, -1))
    steps = representative_steps(long, 8)
    assert len(steps) == 8
    assert {0, 17, 20, 30} <= set(steps)
    assert max(np.diff(steps)) <= 6


def test_more_losses_than_panels_are_thinned_out() -> None:
    alive = np.tril(np.ones((31, 30), bool), 0)[:, ::-1] == 0
    many = RunTrajectory(np.zeros((31, 30, 2)), alive, np.full(30, -1))
    steps = representative_steps(many, 8)
    assert len(steps) == 8
    assert steps[0] == 0
    assert steps[-1] == 30


def test_nobody_leads_where_the_leader_is_lost() -> None:
    assert [leader_at(TRACE, step) for step in range(4)] == [1, 1, 0, 0]
    fallen = RunTrajectory(TRACE.positions, TRACE.alive & [False, True, True], TRACE.leaders)
    assert leader_at(fallen, 3) == -1


def test_a_swarm_follows_the_guide_that_it_is_near_to() -> None:
    assert follows(trace(), GUIDE, 0.05)
    away = RunTrajectory(TRACE.positions + 3.0, TRACE.alive, TRACE.leaders)
    assert not follows(away, GUIDE, 0.05)

"""Close-ups of formations: leaders, losses, mutual protection, and the numbers of members."""

from __future__ import annotations

import numpy as np
import pytest
from figure_cases import DISTRIBUTIONS, GUIDE, RUN, SCENARIO, legend_of, markers, trajectory
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from casswarm.chain import RunTrajectory
from casswarm.figures import formation_chart, joint_map, swarm_map
from casswarm.figures.formations import (
    additional_agent_rates,
    follows_guide,
    leader_at,
    relative_rates,
    representative_steps,
)
from casswarm.studies import trajectory_table
from casswarm.studies.tables import member_table


def places(axes: Axes, marker: str) -> list[tuple[float, float]]:
    return [tuple(line.get_xydata()[0].tolist()) for line in markers(axes, marker)]


def test_formation_chart_shows_leader_alive_and_lost() -> None:
    fig = formation_chart(SCENARIO, RUN, GUIDE, steps=[0, 2, 3], corridors=True)
    first, second, third = fig.axes[:3]
    assert [a.get_title() for a in (first, second, third)] == [
        "step 0: 3 of 3 alive",
        "step 2: 2 of 3 alive",
        "step 3: 2 of 3 alive",
    ]
    assert places(first, "*") == [(0.3, 0.2)]  # member 2 leads
    assert len(places(first, "o")) == 2
    assert not places(first, "X")
    np.testing.assert_allclose(places(second, "X"), [RUN.positions[2, 1] - GUIDE.positions[2]])
    assert places(second, "*") == [(0.0, 0.0)]  # then member 1
    assert not places(third, "X")  # lost before
    assert legend_of(fig) == ["leader", "alive", "lost in this step", "guide", "corridor"]


def test_formation_chart_without_leaders_omits_them_in_legend() -> None:
    leaderless = RunTrajectory(RUN.positions, RUN.alive, np.full(3, -1))
    assert legend_of(formation_chart(SCENARIO, leaderless)) == ["alive", "lost in this step"]


def test_formation_chart_step_beyond_run_raises() -> None:
    with pytest.raises(ValueError, match="allowed: from 0 to 3"):
        formation_chart(SCENARIO, RUN, GUIDE, steps=[4])


def test_additional_agent_rates_equal_hazard_rates() -> None:
    hazard = SCENARIO.hazard
    positions, alive = RUN.positions[2], RUN.alive[2]
    grid = np.array([[[0.3, 0.1], [1.2, -0.4]], [[2.0, 1.0], [-1.0, 0.0]]])
    rates = additional_agent_rates(hazard, grid, positions, alive)
    for index in np.ndindex(2, 2):
        four = np.vstack([positions, grid[index]])
        expected = hazard.rates(four, np.append(alive, True))[3]
        assert rates[index] == pytest.approx(expected, rel=1e-12)


def test_relative_rates_decrease_with_members_alive() -> None:
    hazard, positions = SCENARIO.hazard, RUN.positions[1]
    here = positions.mean(axis=0)[None]
    assert relative_rates(hazard, here, positions, np.zeros(3, bool))[0] == pytest.approx(1)
    all_three = relative_rates(hazard, here, positions, np.ones(3, bool))[0]
    two = relative_rates(hazard, here, positions, RUN.alive[2])[0]
    assert 0 < all_three < two < 1


def test_representative_steps_hold_ends_and_losses() -> None:
    assert representative_steps(RUN, 8) == [0, 1, 2, 3]
    alive = np.ones((31, 3), bool)
    alive[17:, 0] = False
    alive[20:, 1] = False
    long = RunTrajectory(np.zeros((31, 3, 2)), alive, np.full(30, -1))
    steps = representative_steps(long, 8)
    assert len(steps) == 8
    assert {0, 17, 20, 30} <= set(steps)
    assert max(np.diff(steps)) <= 6


def test_representative_steps_with_many_losses_are_thinned() -> None:
    alive = np.tril(np.ones((31, 30), bool), 0)[:, ::-1] == 0
    many = RunTrajectory(np.zeros((31, 30, 2)), alive, np.full(30, -1))
    steps = representative_steps(many, 8)
    assert len(steps) == 8
    assert steps[0] == 0
    assert steps[-1] == 30


def test_leader_at_after_loss_of_leader_is_none() -> None:
    assert [leader_at(RUN, step) for step in range(4)] == [1, 1, 0, 0]
    fallen = RunTrajectory(RUN.positions, RUN.alive & [False, True, True], RUN.leaders)
    assert leader_at(fallen, 3) == -1


def test_follows_guide_requires_small_distance() -> None:
    assert follows_guide(trajectory(), GUIDE, 0.05)
    away = RunTrajectory(RUN.positions + 3.0, RUN.alive, RUN.leaders)
    assert not follows_guide(away, GUIDE, 0.05)


# --- members have one numbering, from 0, in figures, tables and printed texts


LOST = "1"  # the second member of `RUN` is lost


def labels(fig: Figure) -> list[str]:
    return [text.get_text() for text in fig.axes[0].texts]


def test_maps_and_close_ups_number_members_from_0() -> None:
    assert LOST in labels(formation_chart(SCENARIO, RUN, GUIDE, steps=[2]))
    fig = swarm_map(SCENARIO, RUN, GUIDE)
    assert [text for text in legend_of(fig) if "member" in text] == [
        f"member {k}" for k in range(3)
    ]
    assert LOST in labels(fig)
    survival = np.full(RUN.alive.shape, 0.5)
    fig = joint_map(SCENARIO, RUN.positions, survival)
    named = [text for text in legend_of(fig) if "member" in text]
    assert named == [f"member {k},\nsurvival 0.500" for k in range(3)]


def test_tables_number_members_from_0() -> None:
    table = trajectory_table({"leader": [RUN]})
    assert sorted(set(table["member"])) == [0, 1, 2]
    assert set(table.loc[~table["alive"], "member"]) == {int(LOST)}
    assert member_table(DISTRIBUTIONS)["member"].tolist() == [0, 1, 2]

"""Members have one numbering, from 0, in figures, tables and printed texts."""

from __future__ import annotations

import numpy as np
from figure_cases import DISTRIBUTIONS, GUIDE, RUN, SCENARIO
from matplotlib.figure import Figure

from casswarm.figures import formation_chart, joint_map, swarm_map
from casswarm.studies import trajectory_table
from casswarm.studies.tables import member_table

LOST = "1"  # the second member of `RUN` is lost


def legend(fig: Figure) -> list[str]:
    return [text.get_text() for text in fig.legends[0].get_texts()]


def labels(fig: Figure, panel: int = 0) -> list[str]:
    return [text.get_text() for text in fig.axes[panel].texts]


def test_maps_number_members_from_0() -> None:
    fig = swarm_map(SCENARIO, RUN, GUIDE)
    assert [text for text in legend(fig) if "member" in text] == [f"member {k}" for k in range(3)]
    assert LOST in labels(fig)
    survival = np.full(RUN.alive.shape, 0.5)
    fig = joint_map(SCENARIO, RUN.positions, survival)
    named = [text for text in legend(fig) if "member" in text]
    assert named == [f"member {k},\nsurvival 0.500" for k in range(3)]


def test_close_ups_number_members_from_0() -> None:
    fig = formation_chart(SCENARIO, RUN, GUIDE, steps=[2])
    assert LOST in labels(fig)


def test_tables_number_members_from_0() -> None:
    table = trajectory_table({"leader": [RUN]})
    assert sorted(set(table["member"])) == [0, 1, 2]
    assert set(table.loc[~table["alive"], "member"]) == {int(LOST)}
    assert member_table(DISTRIBUTIONS)["member"].tolist() == [0, 1, 2]

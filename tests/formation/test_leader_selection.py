"""Rules of leader selection, on states by hand."""

from __future__ import annotations

import numpy as np
from small_scenarios import DT, Array

from casswarm import Saturation
from casswarm.formation import LEADER_SELECTION
from casswarm.motion import Motion, Step

HAZARD = Saturation(((2.0, 2.0),))


def leaders(rule: str, positions: Array, alive: list[list[int]]) -> list[int]:
    batch = np.array([positions] * len(alive))
    living = np.array(alive, bool)
    step = Step(HAZARD, Motion(2.0, 0.5, DT), batch, 0 * batch, living, np.zeros((1, 2)))
    return [int(i) for i in LEADER_SELECTION[rule](step, np.zeros(2))]


def test_leader_selection_follows_rule_and_breaks_ties_by_index() -> None:
    # distances from the guide 1, 1, 1/2, 2; the radar is nearest to member 3, then to 0 and 1
    positions = np.array([[1.0, 0.0], [0.0, 1.0], [-0.5, 0.0], [2.0, 0.0]])
    alive = [[1, 1, 1, 1], [1, 1, 0, 1], [0, 1, 0, 1], [0, 0, 0, 1]]
    assert leaders("nearest", positions, alive) == [2, 0, 1, 3]
    assert leaders("first", positions, alive) == [0, 0, 1, 3]
    assert leaders("safest", positions[[3, 0, 1, 2]], [[1, 1, 1, 0]]) == [1]
    assert leaders("safest", positions, [[1, 1, 0, 0], [0, 1, 0, 1], [0, 0, 0, 1]]) == [0, 1, 3]


def test_leader_selection_ties_tolerate_the_accuracy_of_decisions() -> None:
    near = np.array([[0.3 + 3e-7, 0.0], [0.3, 0.0], [0.0, 0.3 - 3e-7], [5.0, 5.0]])
    assert leaders("nearest", near, [[1, 1, 1, 1], [0, 1, 1, 1]]) == [0, 1]
    apart = near + np.array([[1e-6, 0.0], [0.0, 0.0], [0.0, -1e-6], [0.0, 0.0]])
    assert leaders("nearest", apart, [[1, 1, 1, 1], [1, 1, 0, 1]]) == [2, 1]


def test_leader_selection_ties_tolerate_rounding() -> None:
    positions = np.array([[0.1 + 0.2, 0.0], [0.0, 0.3], [0.3, 0.0], [5.0, 5.0]])
    assert leaders("nearest", positions, [[1, 1, 1, 1], [0, 1, 1, 1]]) == [0, 1]

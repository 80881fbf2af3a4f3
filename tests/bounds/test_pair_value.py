"""The value function of two members on the nodes of a grid."""

import numpy as np
from small_scenarios import DT, V_MAX, small

from casswarm.bounds import PairValueFunction, pair_bound
from casswarm.joint import PlanDistribution

SCENARIO = small([(0.0, 0.0), (0.2, 0.3)], (2.0, 0.4), [(1.3, 0.7), (2.1, -0.9)], 5)


def test_path_of_pair_keeps_speed_limit_and_arrives():
    value = PairValueFunction.from_scenario(SCENARIO, 300_000)
    path = value.path(SCENARIO.positions)
    assert path.shape == (6, 2, 2)
    np.testing.assert_array_equal(path[0], SCENARIO.positions)
    assert np.abs(np.diff(path, axis=0)).max() <= DT * V_MAX * (1 + 1e-9)
    assert SCENARIO.target.contains(path).any()


def test_value_of_path_is_near_its_exact_law():
    value = PairValueFunction.from_scenario(SCENARIO, 3_000_000)
    path = value.path(SCENARIO.positions)
    predicted = value.after(1, path[1:2])[0]
    law = PlanDistribution.from_positions(SCENARIO, path).success
    assert law.low - 0.01 <= predicted <= pair_bound(SCENARIO, max_nodes=3_000_000).value + 0.01


def test_value_is_zero_outside_grid_and_after_last_step():
    value = PairValueFunction.from_scenario(SCENARIO, 300_000)
    far = np.full((3, 2, 2), 99.0)
    np.testing.assert_array_equal(value.after(2, far), 0.0)
    np.testing.assert_array_equal(value.after(6, far), 0.0)

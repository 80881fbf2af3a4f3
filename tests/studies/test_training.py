"""Training by the exact gradient of the success."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from small_scenarios import small

import casswarm as csw
from casswarm.studies.training import METHODS

SCENARIO = small([(0.0, 0.0), (0.0, 0.3)], (2.0, 0.0), [(1.0, 0.3)], 6, swarm__velocity=[1.0, 0.0])


def common(_step: int, positions: Any, _velocities: Any, _alive: Any, parameters: Any) -> Any:
    to_target = ca.repmat(ca.DM(SCENARIO.target.center).T, 2, 1) - positions
    return to_target + ca.repmat(parameters.T, 2, 1)


@pytest.mark.slow
def test_train_finds_parameters_that_no_neighbour_exceeds() -> None:
    policy = csw.ParametricPolicy(common, [0.0, 0.0], SCENARIO)
    training = csw.train(SCENARIO, policy, stages=[(0.4, 0.0, 20), (0.2, 0.0, 20)])
    width = 0.2 * SCENARIO.target.radius

    def objective(parameters: Any) -> float:
        found = csw.success_gradient(SCENARIO, policy, parameters, 0.0, arrival_smoothing=width)
        return found.objective

    best = objective(training.policy.parameters)
    assert best > objective([0.0, 0.0])
    for shift in np.random.default_rng(0).normal(0.0, 0.02, (10, 2)):
        assert objective(training.policy.parameters + shift) < best + 1e-6
    assert training.success.low >= best - 1e-3
    assert list(training.history["stage"].unique()) == [0, 1]
    last = training.history[training.history["stage"] == 1]["objective"]
    assert last.max() == pytest.approx(best, abs=1e-9)
    assert (
        0.0
        <= training.gap
        == pytest.approx(csw.success_bound(SCENARIO).value - training.success.low)
    )
    assert "gradients=" in repr(training)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_every_method_increases_the_success(method: str) -> None:
    policy = csw.ParametricPolicy(common, [0.0, 0.0], SCENARIO)
    training = csw.train(SCENARIO, policy, method, stages=[(0.4, 0.0, 3)])
    objectives = training.history["objective"]
    assert objectives.max() > 10 * objectives.iloc[0] > 0
    assert training.success.low > 0.05


def test_train_from_a_gradient_of_zeros_warns() -> None:
    policy = csw.ParametricPolicy(common, [0.0, 0.0], SCENARIO)
    with pytest.warns(csw.CasswarmWarning, match=r"stage 0 .* zeros.* its tolerance \(0\.05\)"):
        training = csw.train(SCENARIO, policy, stages=[(0.4, 0.05, 2)])
    np.testing.assert_array_equal(training.policy.parameters, [0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "Nelder-Mead"}, r"method = 'Nelder-Mead'; allowed: L-BFGS-B"),
        ({"stages": []}, "stages is empty"),
        ({"stages": [(2.0, 0.01, 5)]}, r"stage \(2.0, 0.01, 5\); expected \(radii from 0 to 1"),
    ],
)
def test_train_with_wrong_arguments_raises(arguments: dict[str, Any], message: str) -> None:
    policy = csw.ParametricPolicy(common, [0.0, 0.0], SCENARIO)
    with pytest.raises(ValueError, match=message):
        csw.train(SCENARIO, policy, **arguments)

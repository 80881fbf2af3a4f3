"""Results do not depend on the units of length and time."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scaled_scenarios import scaled
from small_scenarios import Array, small

import casswarm as csw
from casswarm import Scenario

LENGTHS = [(1e-3, 1.0), (0.1, 1.0), (10.0, 1.0), (1e3, 1.0)]
TIMES = [(1.0, 1e-3), (1.0, 10.0), (1.0, 1e3)]
SMALL = small(
    [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.3)],
    (3.0, 0.5),
    [(1.5, 1.3), (1.6, -1.0)],
    10,
    guide__a_max=0.3,
)
COLLIDING = SMALL.with_values(
    {"hazard.kind": "saturation+collision", "hazard.beta_1": 0.2, "hazard.beta_2": 6.0}
)
POLICIES = ("naive", "leader", "constrained", "leader-feedback", "leader-mpc-3")


def planned(scenario: Scenario) -> tuple[csw.Guide, list[float]]:
    """A guide, and the numbers about it."""
    guide = csw.plan(scenario)
    assert guide.risk_bound is not None
    failure = csw.success_bound(scenario, 20_000).failure
    return guide, [guide.survival, guide.arrival, guide.risk_bound, failure]


def exact(
    scenario: Scenario, length: float, guide: csw.Guide, policies: tuple[str, ...], tolerance: float
) -> Array:
    """Bounds (policies, 2) of the success of policies."""
    bounds = np.array(
        [
            csw.evaluate(
                scenario, policy, tolerance, guide=guide, max_states=5000, aggregation_tol=length
            ).success
            for policy in policies
        ]
    )
    return bounds.reshape(-1, 2)


def sampled(scenario: Scenario, guide: csw.Guide, policies: tuple[str, ...]) -> list[float]:
    """Frequencies of success, with common random numbers."""
    if not policies:
        return []
    study = csw.simulate(scenario, list(policies), runs=300, guide=guide)
    return study.summary["success"].tolist()


@cache
def reference(scenario: Scenario) -> tuple[list[float], Array]:
    guide, numbers = planned(scenario)
    return numbers, exact(scenario, 1e-8, guide, POLICIES, 1e-7)


SOME = ((10.0, 1.0),)


@pytest.mark.parametrize(
    ("length", "time"),
    [pytest.param(*u, marks=() if u in SOME else pytest.mark.slow) for u in LENGTHS + TIMES],
)
@pytest.mark.parametrize("scenario", [SMALL, COLLIDING], ids=["saturation", "collision"])
def test_results_are_independent_of_units(scenario: Scenario, length: float, time: float) -> None:
    other = scaled(scenario, length, time)
    guide, numbers = planned(other)
    np.testing.assert_allclose(numbers, reference(scenario)[0], rtol=1e-9)
    success = exact(other, 1e-8 * length, guide, POLICIES, 1e-7)
    np.testing.assert_allclose(success, reference(scenario)[1], atol=1e-6)


def test_guide_in_hundredth_of_length_has_same_survival() -> None:
    """The core radius scales with the target."""
    paper = csw.load_scenario("paper-1")
    assert paper.hazard_table.core_radius is None
    survivals = [csw.plan(s, certify=False).survival for s in (paper, scaled(paper, 0.01))]
    assert survivals[0] == pytest.approx(survivals[1], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", csw.builtin_scenarios())
def test_builtin_scenarios_are_independent_of_units(name: str) -> None:
    scenario = csw.load_scenario(name)
    guide, numbers = planned(scenario)
    policies = POLICIES[:3] if scenario.n <= 12 else ()
    success = exact(scenario, 1e-6, guide, policies, 1e-3)
    frequencies = sampled(scenario, guide, policies)
    for length, time in LENGTHS + TIMES:
        other = scaled(scenario, length, time)
        guide, others = planned(other)
        np.testing.assert_allclose(others, numbers, rtol=1e-6)
        again = exact(other, 1e-6 * length, guide, policies, 1e-3)
        # solutions differ by rounding, and with them which of the states are identified
        np.testing.assert_allclose(again[:1], success[:1], atol=1e-6)
        overlap = np.minimum(again, success)[:, 1] - np.maximum(again, success)[:, 0]
        assert (overlap >= -1e-9).all()
        assert sampled(other, guide, policies) == frequencies

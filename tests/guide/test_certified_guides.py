"""Certified guides: equal optima, straight lines, users' rates, limits, and errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from numpy.typing import ArrayLike
from small_scenarios import TWO, bounded_patrol, free, patrolled

from casswarm import HazardError, Saturation, ScenarioError, load_scenario, plan
from casswarm.guide import certify_guide
from casswarm.typing import FloatArray


def test_plan_symmetric_scenario_reports_one_of_two_optima() -> None:
    guide = plan(free((6.0, 0.0), [(3.0, 0.0)], 14), gap=1e-4)
    classes = guide.best_per_homotopy_class()
    assert [candidate.homotopy for candidate in classes] in (["L", "R"], ["R", "L"])
    assert classes[0].risk == pytest.approx(classes[1].risk, rel=1e-6)
    assert guide.risk == classes[0].risk
    assert guide.gap < 1e-4


def test_certificate_uniform_rate_has_gap_of_rounding() -> None:
    scenario = free((6.0, 0.0), [(50.0, 50.0)], 12).with_hazard(bounded_patrol, background=0.3)
    guide = plan(scenario, gap=1e-6)
    assert guide.arrival == 9
    assert guide.risk == pytest.approx(0.3 * 9 * 0.33, rel=1e-12)
    assert 0 <= guide.gap < 1e-9


def test_certificate_custom_hazard_needs_lower_bound() -> None:
    scenario = free((5.0, 1.0), [(2.5, 0.2)], 16)
    plain = plan(scenario.with_hazard(patrolled, radars=[(2.5, 0.2)]))
    assert (plain.risk_bound, plain.gap, plain.certificate) == (None, None, None)
    assert "not certified" in str(plain)
    certified = plan(scenario.with_hazard(bounded_patrol, radars=[(2.5, 0.2)]), gap=0.003)
    assert certified.risk == pytest.approx(plain.risk, rel=1e-9)
    assert 0 <= certified.gap <= 0.003


def test_certificate_custom_hazard_wrong_lower_bound_raises() -> None:
    def wrong(positions: ca.MX, alive: ca.MX) -> ca.MX:
        return patrolled(positions, alive)

    wrong.lower_bound = lambda lower, upper: 0.2 + 0 * lower[..., 0]  # noqa: ARG005
    scenario = free((5.0, 1.0), [(2.5, 0.2)], 16)
    with pytest.raises(HazardError, match="is not a lower bound"):
        plan(scenario.with_hazard(wrong))
    wrong.lower_bound = lambda lower, upper: 0.05  # noqa: ARG005
    with pytest.raises(HazardError, match="expected one number per box"):
        plan(scenario.with_hazard(wrong))


@dataclass(frozen=True)
class Weaker(Saturation):
    """With a kernel of its own, of which the paper's bound knows nothing."""

    def source(self, squared_distance: ca.SX) -> ca.SX:
        return 0.1 / (1.0 + squared_distance)


class Halved(Saturation):
    """With rates of its own, whatever their kernels."""

    def rates(self, positions: ArrayLike, alive: ArrayLike | None = None) -> FloatArray:
        return 0.5 * super().rates(positions, alive)

    def single_agent_rates(self, points: ArrayLike) -> FloatArray:
        return 0.5 * super().single_agent_rates(points)


class Same(Saturation):
    """With nothing of its own."""


@pytest.mark.parametrize("kind", [Weaker, Halved, Same])
def test_hazard_subclass_does_not_inherit_lower_bound(kind: type[Saturation]) -> None:
    hazard = kind(tuple(TWO))
    corner = np.zeros(2)
    assert hazard.single_agent_lower_bound(corner, corner) is None
    assert hazard.single_agent_rates_below(np.zeros(2), np.zeros(2), 0.1) is None
    assert hazard.least_rate(3) is None


@pytest.mark.parametrize(
    ("target", "radars", "steps"),
    [
        ((4.0, 0.0), [(4.0 + math.cos(a), math.sin(a)) for a in np.arange(6) * math.pi / 3], 16),
        ((4.0, 1.0), [(0.05, 0.02)], 14),
        ((5.5, 3.0), [(2.0, 2.0)], 8),  # a distance of 5.0 with a reach of 5.28
    ],
    ids=["target enclosed by radars", "start next to a radar", "just reachable"],
)
def test_certificate_hard_geometry_reaches_gap(target, radars, steps) -> None:
    guide = plan(free(target, radars, steps), gap=0.001)
    assert 0 <= guide.gap <= 0.001


def test_scenario_unreachable_target_reports_fewest_steps() -> None:
    with pytest.raises(ScenarioError, match="the fastest path takes 9 steps"):
        free((6.0, 0.0), [(2.0, 2.0)], 8)


def test_certificate_acceleration_limit_adds_bound_and_keeps_the_other() -> None:
    values = {"guide.search": "global", "guide.arrival": "any", "guide.margin": 0.0}
    scenario = load_scenario("paper-1").with_values(values)
    free, limited = (
        plan(scenario.with_values({"guide.acceleration_limited": acceleration_limited}))
        for acceleration_limited in (False, True)
    )
    assert free.certificate.accelerated is None
    assert max(free.gap, limited.gap) < 0.01
    assert limited.certificate.best == pytest.approx(free.risk, rel=1e-5)
    assert limited.certificate.bound == pytest.approx(free.risk_bound, rel=0.01)
    assert limited.certificate.bound < 0.95 * limited.risk_bound


@pytest.mark.slow
def test_certificate_uses_path_that_misses_target_by_tolerance() -> None:
    """At full speed nearly everywhere, so that what the dynamics miss adds up to a rim not met."""
    certificate = certify_guide(load_scenario("ring"), plan(load_scenario("ring"), certify=False))
    assert certificate.best == pytest.approx(1.1039, abs=2e-4)
    assert certificate.gap < 0.01


def test_plan_without_certify_has_no_certificate() -> None:
    scenario = free((4.0, 1.0), [(2.0, 0.5)], 12)
    assert plan(scenario, certify=False).certificate is None
    assert certify_guide(scenario, plan(scenario, certify=False)).gap < 0.01

"""``time.substeps``: risks are counted at the ends of parts of a step."""

from __future__ import annotations

import numpy as np
import pytest
from brute_force import commanded, law_by_hand, success_of
from scaled_scenarios import scaled
from scipy.integrate import quad
from small_scenarios import small

import casswarm as csw
from casswarm.bounds.success_bound import CLOCKS
from casswarm.errors import ScenarioError
from casswarm.guide.frame import SYMMETRIES
from casswarm.joint import PlanDistribution

STARTS = [(0.0, 0.0), (0.2, 0.4), (-0.6, -0.3)]
ONE = small(STARTS, (1.6, 0.0), [(0.9, 0.5)], 4, swarm__a_max=8.0, swarm__velocity=[0.5, 0.0])
MOVING = [{"position": [0.9, 0.9], "velocity": [0.3, -0.6]}]
IN_TIME = ONE.replace(hazard={"radars": [], "radar": MOVING})
SINGLE = small([(0.0, 0.0)], (3.2, 0.0), [(1.6, 0.35)], 8, swarm__a_max=8.0)


def parted(one: csw.Scenario, m: int) -> csw.Scenario:
    return one.replace(time={"substeps": m})


@pytest.mark.parametrize("m", [2, 3])
@pytest.mark.parametrize("plain", [ONE, IN_TIME], ids=["rest", "time"])
def test_law_is_that_of_a_recursion_of_the_equations(plain: csw.Scenario, m: int) -> None:
    one = parted(plain, m)
    policy = csw.make_policy("leader", one)
    start = np.tile(one.swarm.velocity, (one.n, 1))
    expected = success_of(law_by_hand(one, start, commanded(one, policy)))
    exact = csw.evaluate(one, policy, 1e-9, aggregation_tol=0.0).success
    assert exact.low == pytest.approx(expected, abs=1e-8)
    assert abs(exact.low - csw.evaluate(plain, "leader", 1e-9).success.low) > 1e-3
    runs = csw.simulate(one, [policy], 4000, seed=1).summary.success[0]
    assert abs(runs - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 4000)


def test_a_radar_cannot_be_jumped_over() -> None:
    """The risk of a step across a radar tends to the integral over the step."""
    short = small([(0.0, 0.0)], (2.0, 0.0), [(1.0, 0.4)], 4)
    long = short.replace(time={"dt": 1.0, "t_f": 1.0})
    guides = {m: csw.plan(parted(long, m), certify=False) for m in (1, 400)}
    path = guides[400].positions

    def rate(share: float) -> float:
        return float(long.hazard.single_agent_rates(path[0] + share * (path[1] - path[0])))

    integral = quad(rate, 0.0, 1.0, points=[0.5])[0]
    assert guides[400].risk == pytest.approx(integral, rel=0.01)
    assert guides[400].risk > 2.5 * guides[1].risk


def test_guide_minimises_the_risk_over_parts() -> None:
    one = parted(SINGLE, 4)
    guide, plain = csw.plan(one), csw.plan(SINGLE, certify=False)
    by_hand = 0.0
    for x, y in zip(guide.positions[:-1], guide.positions[1:], strict=True):
        points = [x + k / 4 * (y - x) for k in range(1, 5)]
        by_hand += one.time.dt * one.hazard.single_agent_rates(points).mean()
    assert guide.risk == pytest.approx(by_hand, rel=1e-12)
    assert guide.solution.objective == pytest.approx(by_hand, rel=1e-6)
    of_plain = one.time.dt * one.rates_along(plain.positions).sum()
    assert guide.risk < of_plain - 1e-4
    law = csw.evaluate(one, "naive", 1e-9, guide=guide).success
    assert law.low == pytest.approx(guide.survival, abs=1e-7)


@pytest.mark.slow
def test_bounds_hold_for_paths_that_turn_after_parts() -> None:
    one = parted(SINGLE, 3)
    guide = csw.plan(one)
    assert guide.certificate is not None
    assert guide.certificate.accelerated is None
    finer = csw.plan(one.by_parts.replace(swarm={"a_max": 100.0}))
    assert guide.certificate.bound <= finer.risk * (1 + 1e-12)
    assert guide.certificate.bound >= 0.97 * finer.risk
    assert guide.certificate.bound < guide.risk


@pytest.mark.parametrize("k", [1, 2])
def test_success_bound_is_of_independent_clocks(k: int) -> None:
    one = parted(ONE, 3).replace(success={"arrivals": k})
    bound = csw.success_bound(one)
    assert bound.method == CLOCKS
    for name in ("naive", "leader", "constrained", "leader-mpc-2"):
        assert csw.evaluate(one, name, 1e-9).success.high <= bound.value


def test_exact_law_of_a_plan_counts_the_parts() -> None:
    one = parted(IN_TIME, 3)
    way = one.positions + np.linspace([[0.0, 0.0]], [[2.0, 0.0]], 5)

    def follow(step: int, x: np.ndarray, _v: np.ndarray, alive: np.ndarray) -> np.ndarray:
        return (way[step + 1] - x) / one.time.dt * alive[..., None]

    policy = csw.as_policy(follow)
    exact = csw.evaluate(one, policy, 0.0, aggregation_tol=0.0).success
    stated = PlanDistribution.from_positions(one, way).success
    assert 0.1 < stated.low < 0.99
    assert stated.low == pytest.approx(exact.low, abs=1e-12)


@pytest.mark.slow
def test_guide_does_not_depend_on_axes_or_units() -> None:
    one = parted(ONE, 3)
    guide, other = csw.plan(one), csw.plan(scaled(one, 10.0, 0.1))
    assert other.survival == pytest.approx(guide.survival, abs=1e-9)
    assert other.survival_bound == pytest.approx(guide.survival_bound, abs=1e-9)
    values = {"swarm.positions": one.positions @ SYMMETRIES[5].T}
    values |= {"target.center": SYMMETRIES[5] @ one.target.center}
    values |= {"swarm.velocity": SYMMETRIES[5] @ one.swarm.velocity}
    values |= {"hazard.radars": np.array(one.hazard_table.radars) @ SYMMETRIES[5].T}
    image = csw.plan(one.with_values(values))
    np.testing.assert_array_equal(image.positions, guide.positions @ SYMMETRIES[5].T)


def test_too_many_parts_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"time\.substeps is 50000 in each of 4 steps"):
        parted(ONE, 50_000)

"""Results do not depend on units, axes, the origin, or the order of members."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable
from functools import cache, partial

import numpy as np
import pytest
from scaled_scenarios import scaled
from small_scenarios import TWO, Array, abreast, colliding, image, pair, small

import casswarm as csw
from casswarm import Scenario
from casswarm.bounds import acceleration_limits, bound_with_acceleration, pair_bound
from casswarm.grid import Relaxation
from casswarm.guide.frame import SYMMETRIES

IMAGES = {
    "mirrored": (np.diag([1.0, -1.0]), (0.0, 0.0)),
    "reversed": (np.diag([-1.0, 1.0]), (0.0, 0.0)),
    "swapped": (np.array([[0.0, 1.0], [1.0, 0.0]]), (0.0, 0.0)),
    "turned": (np.array([[0.0, -1.0], [1.0, 0.0]]), (0.0, 0.0)),
    "shifted": (np.eye(2), (-7.0, 3.0)),
}
"""Isometries that keep the square of the speed limit: a matrix and a shift."""

LENGTHS = [(1e-3, 1.0), (0.1, 1.0), (10.0, 1.0), (1e3, 1.0)]
TIMES = [(1.0, 1e-3), (1.0, 10.0), (1.0, 1e3)]
SMALL = small(
    [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.3)],
    (3.0, 0.5),
    [(1.5, 1.3), (1.6, -1.0)],
    10,
    guide__a_max=0.3,
)
KNOWN = [name for name in csw.builtin_scenarios() if len(csw.load_scenario(name).cases) == 1]
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length", "time"),
    [pytest.param(*u, marks=() if u in SOME else pytest.mark.slow) for u in LENGTHS + TIMES],
)
@pytest.mark.parametrize("scenario", [SMALL, colliding(SMALL)], ids=["saturation", "collision"])
def test_results_are_independent_of_units(scenario: Scenario, length: float, time: float) -> None:
    other = scaled(scenario, length, time)
    guide, numbers = planned(other)
    np.testing.assert_allclose(numbers, reference(scenario)[0], rtol=1e-9)
    success = exact(other, 1e-8 * length, guide, POLICIES, 1e-7)
    np.testing.assert_allclose(success, reference(scenario)[1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", KNOWN)
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


# --- axes, origin and order


@pytest.mark.parametrize("name", IMAGES)
def test_plan_of_image_is_image_of_plan(name: str) -> None:
    matrix, shift = IMAGES[name]
    scenario = small([(0.2, 0.1)], (6.0, 3.0), [(2.0, 2.0), (4.5, 1.0), (3.0, -0.4)], 15)
    reference, guide = csw.plan(scenario), csw.plan(image(scenario, matrix, shift=shift))
    assert guide.risk == pytest.approx(reference.risk, rel=1e-6)
    assert guide.arrival == reference.arrival
    np.testing.assert_allclose(guide.positions, reference.positions @ matrix.T + shift, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("matrix", [SYMMETRIES[3], SYMMETRIES[7]])
def test_guide_of_image_is_image_of_guide_to_the_last_digit(matrix: Array) -> None:
    """So are bounds of a proof that ended at its gap."""
    values = {"swarm__velocity": (1.0, -1.0), "swarm__a_max": 0.3}
    scenario = small([(0.0, 0.0)], (3.0, 1.0), [(1.2, 0.9), (1.6, -0.3)], 7, **values)
    guide, other = (csw.plan(s, gap=0.05) for s in (scenario, image(scenario, matrix)))
    np.testing.assert_array_equal(other.positions, guide.positions @ matrix.T)
    mirrored = str.maketrans("LR", "RL" if np.linalg.det(matrix) < 0 else "LR")
    for one, its_image in zip(guide.candidates, other.candidates, strict=True):
        assert its_image.homotopy == one.homotopy.translate(mirrored)
        np.testing.assert_array_equal(its_image.velocities, one.velocities @ matrix.T)
        x = one.solution.x.reshape(-1, 2) @ matrix.T
        np.testing.assert_array_equal(its_image.solution.x, x.ravel())
    proofs = [g.certificate for g in (guide, other)]
    bounds = [(p.bound, p.accelerated.bound, p.accelerated.regions) for p in proofs]
    assert bounds[0] == bounds[1]
    assert bounds[0][2] > 20


STEERED_PAIR = small(
    [(0.0, 0.0), (0.3, 0.2)],
    (2.2, 0.0),
    [(1.2, 0.4), (1.6, -0.9)],
    6,
    hazard__alpha_1=8.0,
    swarm__velocity=(1.0, 0.5),
)
CROSSING = abreast(2, 6, swarm__velocity=(1.0, 0.2))


TURNING = small([(0.0, 0.0)], (5.0, 2.0), TWO, 12, swarm__a_max=0.1)


def level_game(scenario: Scenario) -> float:
    return csw.success_bound(scenario, 50_000, max_work=1e6).value


def pairs(scenario: Scenario) -> float:
    return pair_bound(scenario, max_nodes=300_000).value


def optimal(scenario: Scenario) -> float:
    return csw.evaluate(scenario, "optimal", 0.0).success.low


def joint(scenario: Scenario) -> float:
    return csw.plan_swarm(scenario, initial_guesses=["formations"]).value


def accelerated(scenario: Scenario) -> tuple[float, int]:
    """Bound of the risk that is found for TURNING, and the number of regions."""
    task, limits = Relaxation.from_scenario(scenario), acceleration_limits(scenario)
    risk, deadline = csw.plan(TURNING, certify=False).risk, clock.monotonic() + 20
    options = {"gap": 0.01, "deadline": deadline, "first_nodes": 50_000}
    found = bound_with_acceleration(task, limits, risk, **options)
    return found.bound, found.regions


def backwards(scenario: Scenario) -> Scenario:
    """With members and radars in reverse order."""
    radars = list(scenario.hazard_table.radars)
    values = {"swarm.positions": scenario.positions[::-1], "hazard.radars": radars[::-1]}
    return scenario.with_values(values)


CHANGES: dict[str, Callable[[Scenario], Scenario]] = {
    **{name: partial(image, matrix=m, shift=shift) for name, (m, shift) in IMAGES.items()},
    "backwards": backwards,
    "in small units": partial(scaled, length=1024.0),
}
NUMBERS: dict[str, tuple[Scenario, Callable[[Scenario], object], float, Iterable[str]]] = {
    "level game": (csw.load_scenario("alley"), level_game, 1e-9, [*IMAGES, "backwards"]),
    "bound of pairs": (pair(), pairs, 1e-3, IMAGES),  # whose grid begins at the first
    "bound of colliding pairs": (colliding(pair()), pairs, 1e-3, IMAGES),
    "optimal policy": (STEERED_PAIR, optimal, 1e-5, ["backwards"]),
    "joint plan": (CROSSING, joint, 1e-6, ["shifted"]),  # rounds, and solves differ by that
    "bound with acceleration": (TURNING, accelerated, 1e-9, ["in small units"]),
}
"""Scenario, number, its relative tolerance, and changes of the scenario that do not change it."""


@pytest.mark.slow
@pytest.mark.parametrize("name", NUMBERS)
def test_number_of_changed_scenario_is_equal(name: str) -> None:
    scenario, number, tolerance, changes = NUMBERS[name]
    expected = number(scenario)
    for change in changes:
        found = number(CHANGES[change](scenario))
        np.testing.assert_allclose(found, expected, rtol=tolerance, err_msg=change)

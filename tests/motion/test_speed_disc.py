"""``swarm.speed = "disc"``: the speed is limited in every direction."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from brute_force import commanded, law_by_hand, success_of
from env_cases import outcomes
from small_scenarios import small

import casswarm as csw
from casswarm.envs import SwarmVectorEnv
from casswarm.errors import ScenarioError
from casswarm.grid.nodes import disc_windows

STARTS = [(0.0, 0.0), (0.2, 0.4), (-0.6, -0.3)]
BOX = small(STARTS, (1.3, 1.3), [(1.0, 0.4)], 5, swarm__a_max=2.0, swarm__velocity=[0.5, 0.5])
ONE = BOX.replace(swarm={"speed": "disc"})
SINGLE = small([(0.0, 0.0)], (3.0, 1.0), [(1.4, 0.9), (2.0, -0.4)], 8, swarm__a_max=2.0)
ROUND = SINGLE.replace(swarm={"speed": "disc"})


def turned(one: csw.Scenario, angle: float) -> csw.Scenario:
    """The scenario with all points turned about the origin."""
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return one.with_values(
        {
            "swarm.positions": one.positions @ turn.T,
            "target.center": turn @ one.target.center,
            "hazard.radars": np.array(one.hazard_table.radars) @ turn.T,
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.3, 0.7, 2.0])
def test_nothing_depends_on_a_direction(angle: float) -> None:
    guide, other = csw.plan(ROUND), csw.plan(turned(ROUND, angle))
    assert other.risk == pytest.approx(guide.risk, rel=1e-6)
    for each in (guide, other):
        assert np.hypot(*each.velocities.T).max() <= ROUND.swarm.v_max * (1 + 1e-12)
        assert each.risk_bound <= min(guide.risk, other.risk) * (1 + 1e-9)
        assert each.gap < 0.1
    laws = [csw.evaluate(s, "leader", 1e-9).success.low for s in (ROUND, turned(ROUND, angle))]
    assert laws[0] == pytest.approx(laws[1], abs=1e-6)


@pytest.mark.slow
def test_guide_is_slower_than_in_the_box_and_its_bound_is_sharper() -> None:
    guide, box = csw.plan(ROUND), csw.plan(SINGLE)
    assert guide.risk > box.risk * 1.01
    assert guide.certificate.bound > box.certificate.bound
    assert guide.certificate.bound <= guide.certificate.best


def test_arrival_takes_the_time_of_the_distance() -> None:
    free = small([(0.0, 0.0)], (3.0, 3.0), [(40.0, 40.0)], 9, hazard__alpha_1=1e-6)
    needed = math.ceil((math.hypot(3, 3) - 0.5) / (free.time.dt * free.swarm.v_max))
    early = free.replace(time={"t_f": free.time.dt * (needed - 1)})
    csw.plan(early, certify=False)
    with pytest.raises(ScenarioError, match=f"the distance is .* takes {needed} steps"):
        early.replace(swarm={"speed": "disc"})
    assert csw.plan(free.replace(swarm={"speed": "disc"}), certify=False).arrival >= needed


@pytest.mark.parametrize("name", ["naive", "leader", "constrained"])
def test_law_is_that_of_a_recursion_of_the_equations(name: str) -> None:
    policy = csw.make_policy(name, ONE)
    start = np.tile(ONE.swarm.velocity, (ONE.n, 1))
    expected = success_of(law_by_hand(ONE, start, commanded(ONE, policy)))
    exact = csw.evaluate(ONE, policy, 1e-9, aggregation_tol=0.0).success
    assert exact.low == pytest.approx(expected, abs=1e-8)
    assert exact.high <= csw.success_bound(ONE, max_work=1e6).value
    assert csw.success_bound(ONE, max_work=0).value <= csw.success_bound(BOX, max_work=0).value


def test_commands_are_shortened_to_the_disc() -> None:
    fast = csw.as_policy(lambda _t, x, _v, alive: np.where(alive[..., None], 1.9, 0.0) + 0 * x)
    loose = ONE.replace(swarm={"a_max": 100.0})
    study = csw.simulate(loose, [fast], 5, seed=1, save_trajectories=5)
    for run in next(iter(study.trajectories.values())):
        moves = np.diff(run.positions, axis=0) / loose.time.dt
        living = run.alive[1:]
        speeds = np.hypot(moves[..., 0], moves[..., 1])[living]
        np.testing.assert_allclose(speeds, loose.swarm.v_max, rtol=1e-9)
    assert study.summary.saturated[0] > 0


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_formations_of_two_solvers_agree(name: str) -> None:
    guide = csw.plan(ONE, certify=False)
    policies = [csw.make_policy(name, ONE, guide, solver=solver) for solver in ("auto", "ipopt")]
    chances = [csw.evaluate(ONE, each, 1e-6, guide=guide).success for each in policies]
    assert chances[0].low == pytest.approx(chances[1].low, abs=1e-3)


def test_environment_has_the_runs_of_simulate() -> None:
    guide = csw.plan(ONE, certify=False)
    table = outcomes(
        SwarmVectorEnv(ONE, 40, guide=guide), csw.make_policy("leader", ONE, guide), 7, episodes=2
    )
    runs = csw.simulate(ONE, ["leader"], runs=80, seed=7, guide=guide).runs
    np.testing.assert_array_equal(table["success"], runs["success"])
    np.testing.assert_array_equal(table["survivors"], runs["survivors"])


@pytest.mark.parametrize("reach", [1, 2, 3, 5, 8, 16, 21, 64])
def test_windows_hold_all_nodes_that_are_reached(reach: int) -> None:
    windows, k = disc_windows(reach), range(-reach, reach + 1)
    assert set(windows) == {(north, east) for east, north in windows}  # as a quarter turn maps them
    for i, j in product(k, k):
        if math.hypot(i, j) <= reach + math.sqrt(2):
            assert any(abs(i) <= east and abs(j) <= north for east, north in windows)
    held = sum(any(abs(i) <= e and abs(j) <= n for e, n in windows) for i, j in product(k, k))
    disc = sum(math.hypot(i, j) <= reach + math.sqrt(2) for i, j in product(k, k))
    assert held <= 1.06 * disc


def test_a_velocity_beyond_the_disc_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"swarm\.velocity is \[1\.8, 1\.8\]; its length"):
        ONE.replace(swarm={"velocity": [1.8, 1.8]})
    BOX.replace(swarm={"velocity": [1.8, 1.8]})
    with pytest.raises(ScenarioError, match=r"swarm\.speed is 'ball'; it must be 'box' or 'disc'"):
        ONE.replace(swarm={"speed": "ball"})

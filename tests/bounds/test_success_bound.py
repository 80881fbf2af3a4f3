"""The bound on every policy: lemmas, known answers, and policies that do not exceed it."""

from __future__ import annotations

import math
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from small_scenarios import ALPHA, DT, V_MAX, pair, patrolled, single_agent_rate_by_hand, small

from casswarm import SuccessBound, evaluate, load_scenario, plan, success_bound
from casswarm.bounds import certify, level_game, pair_bound
from casswarm.grid import Relaxation
from casswarm.hazard import SaturationCollision
from casswarm.hazard.rate_bounds import LeastRate
from casswarm.joint import PlanDistribution

FACTOR = (1 + ALPHA[1]) / (1 + 3 * ALPHA[1])  # least relative rate among three


# --- known answers


def test_success_bound_single_member_matches_risk_bound() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.0), [(1.4, 1.0)], 8)
    task = Relaxation.from_scenario(scenario)
    guide = plan(scenario, search="global")
    certified = certify(task, guide.risk, gap=1e-4, time_limit=10.0).bound
    bound = success_bound(scenario, 2_000_000)
    assert bound.risks[0] == pytest.approx(certified, rel=5e-3)
    assert bound.value == pytest.approx(math.exp(-bound.risks[0]), abs=1e-12)
    assert bound.value >= guide.survival


def test_success_bound_is_attained_in_one_step() -> None:
    """Three members at one position take one step together, with the best possible protection."""
    radar, reach = (4.0, 0.3), DT * V_MAX
    scenario = small([(0.0, 0.0)] * 3, (0.9, 0.0), [radar], 1, swarm__a_max=100.0)
    bound = success_bound(scenario, 4_000_000, max_work=0)
    # the rim's point that is farthest from the radar, within reach
    angles = np.linspace(0, 2 * np.pi, 200_001)
    rim = np.array([0.9, 0.0]) + 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    inside = rim[(np.abs(rim) <= reach).all(axis=1)]
    corners = np.array([(reach, -math.sqrt(0.25 - (0.9 - reach) ** 2)), *inside])
    rates = np.array([single_agent_rate_by_hand(x, y, [radar]) for x, y in corners])
    point = corners[rates.argmin()]
    success = 1 - (1 - math.exp(-DT * FACTOR * rates.min())) ** 3
    assert success <= bound.value <= success + 1e-4
    game = success_bound(scenario, 4_000_000, max_work=1e7)
    assert game.value == bound.value  # it is not below what is attained
    paths = np.stack([np.zeros((3, 2)), np.tile(0.9 + (point - 0.9) * (1 - 1e-9), (3, 1))])
    paths[1] = point
    assert PlanDistribution.from_positions(scenario, paths).cost("success") >= bound.failure


def test_success_bound_is_monotone() -> None:
    scenario = load_scenario("paper-1")
    coarse, fine = (success_bound(scenario, nodes, max_work=0) for nodes in (100_000, 4_000_000))
    assert coarse.failure <= fine.failure <= 1.15 * coarse.failure
    longer = scenario.with_values({"time.t_f": 12.0})
    calm = success_bound(scenario, max_work=0)
    assert success_bound(longer, 4_000_000, max_work=0).value >= calm.value


def test_success_bound_is_sharper_with_collisions() -> None:
    scenarios = [load_scenario(name) for name in ("paper-1", "paper-2")]
    calm, crowded = (success_bound(scenario, max_work=0) for scenario in scenarios)
    assert crowded.failure > 10 * calm.failure


LEVEL_GAME = partial(success_bound, max_nodes=100_000, max_work=3e6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "bound", "strengths"),
    [
        (load_scenario("paper-1"), success_bound, (4.0, 5.0)),
        (load_scenario("alley"), LEVEL_GAME, (2, 3, 4)),
        (pair(), partial(pair_bound, max_nodes=300_000), (1, 4, 16)),
    ],
)
def test_bound_falls_with_rates(scenario, bound, strengths):
    values = [bound(scenario.with_values({"hazard.alpha_1": s})).value for s in strengths]
    assert (np.diff(values) < 0).all()
    assert values[-1] > 0


@pytest.mark.parametrize(
    "name", ["paper-1", pytest.param("paper-2", marks=pytest.mark.slow), "gauntlet"]
)
def test_success_bound_exceeds_leader_on_paper_scenarios(name):
    scenario = load_scenario(name)
    bound = float(success_bound(scenario))
    leader = evaluate(scenario, "leader", 1e-2, max_states=20_000)  # a lower end suffices
    assert leader.success.low < bound < 1.0


# --- the least rate


def test_least_rate_with_collisions_matches_best_spacing() -> None:
    """Two members: the least over their distance, by search."""
    hazard = SaturationCollision([(0.0, 0.0)], None, 4.0, 3.0, 4.0, 0.2, 6.0)
    least = hazard.least_rate(2)
    assert least is not None
    h = np.linspace(1e-6, 1 - 1e-9, 400_001)
    g = (0.04 / np.maximum((1 / h - 1) / 4.0, 1e-12)) ** 3
    for b in (0.1, 1.0, 10.0):
        exact = (b * 4.0 / (1 + 3.0 * (1 + h)) + g).min()
        assert exact * 0.999 <= least(np.array(b)) <= exact * (1 + 1e-9)


def test_least_rate_is_minimum_of_lines() -> None:
    rng = np.random.default_rng(0)
    lines = np.sort(rng.random(40)), np.sort(rng.random(40))[::-1]
    least = LeastRate(*lines)
    b = np.concatenate([[0.0], 10.0 ** rng.uniform(-3, 3, 200)])
    brute = (lines[0][:, None] + lines[1][:, None] * b).min(axis=0)
    np.testing.assert_allclose(least(b), brute, rtol=1e-12)


# --- reports


def test_success_bound_custom_hazard_reports_reason() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.0), [(1.4, 1.0)], 8)
    bound = success_bound(scenario.with_hazard(patrolled, radars=[(1.4, 1.0)]))
    assert not bound.certified
    assert float(bound) == 1.0
    assert "CustomHazard does not provide the least rate of a member among 1" in str(bound)


@pytest.mark.parametrize(
    ("failure", "shown"),
    [
        (4.1739e-6, "0.9999959"),
        (1.6e-4, "0.99984"),
        (0.04, "0.9600"),
        (0.5, "0.5001"),
        (3.17e-50, "1 - 3.1e-50"),
        (0.0, "1"),
    ],
)
def test_success_bound_is_rounded_upward(failure: float, shown: str) -> None:
    bound = SuccessBound(failure, (1.0,))
    assert str(bound) == f"no policy can exceed {shown} (independent clocks)"
    assert float(bound) >= 1 - failure


# --- targets just within reach, members far out of it


@pytest.mark.parametrize(("v_max", "length"), [(2.0, 1.0), (1e-8, 1e-8)])
@pytest.mark.parametrize("beyond", [4e-10, 1e-10, 1e-12, 0.0])
def test_success_bound_holds_for_policies_that_ask_for_more_than_v_max(
    v_max: float, length: float, beyond: float
) -> None:
    scenario = load_scenario("single-agent")
    radius, steps = 0.5 * length, 10
    reach = steps * scenario.time.dt * v_max
    scenario = scenario.with_values(
        {
            "swarm.v_max": v_max,
            "swarm.velocity": [v_max, 0.0],
            "target.center": [(1 + beyond) * reach + radius, 0.0],
            "target.radius": radius,
            "time.t_f": steps * scenario.time.dt * (1 + 1e-9),
            "hazard.radars": [[0.5 * reach, 3.0 * length + 0.02]],
        }
    )
    guide = plan(scenario, certify=False, check=False)

    def hasty(_step, positions, _previous_velocities, _alive):  # type: ignore[no-untyped-def]
        return np.broadcast_to([v_max + 0.9e-9, 0.0], positions.shape)

    success = evaluate(scenario, hasty, guide=guide).success
    assert success.low <= float(success_bound(scenario))


@pytest.mark.parametrize("alpha_2", [0.0, ALPHA[1]])
@pytest.mark.parametrize("far", [50.0, 1e4, 1e9, 1e15])
def test_success_bound_member_out_of_reach_only_protects(far: float, alpha_2: float) -> None:
    members, values = [(0.0, 0.0), (0.1, 0.0)], {"hazard__alpha_2": alpha_2}
    two, three = (
        success_bound(
            small([*members, *others], (3.0, 0.5), [(1.5, 1.3)], 10, **values), 20_000, max_work=0
        )
        for others in ([], [(far, -far)])
    )
    assert three.risks[2] == math.inf
    fraction = (1 + 2 * alpha_2) / (1 + 3 * alpha_2)
    np.testing.assert_allclose(three.risks[:2], fraction * np.array(two.risks), rtol=0.02)
    if alpha_2 == 0.0:
        assert three.failure == pytest.approx(two.failure, rel=0.02)


# --- memory, wherever the members are

CODE = """
import resource
import sys
from pathlib import Path

import casswarm as csw

scenario = csw.load_scenario("paper-1")
far = float(sys.argv[1])
values = {"swarm.positions": [[far, 0.0], *map(list, scenario.positions[1:])]}
if sys.argv[2] == "reachable":
    values |= {"target.center": [far / 2, 0.0], "target.radius": far / 2 - 10.0}
    values |= {"hazard.core_radius": 0.01}
scenario = scenario.with_values(values)
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + 600_000_000
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
print(*csw.success_bound(scenario).risks)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits memory as on Linux")
@pytest.mark.parametrize(
    "far", ["1500", *(pytest.param(far, marks=pytest.mark.slow) for far in ("1e8", "2e9"))]
)
@pytest.mark.parametrize("kind", ["reachable", "unreachable"])
def test_far_members_need_no_more_memory(far, kind):
    done = subprocess.run(
        [sys.executable, "-c", CODE, far, kind], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    risks = np.array(done.stdout.split(), float)
    assert (risks[0] == np.inf) == (kind == "unreachable")
    assert (risks[1:] >= 0).all()
    assert np.isfinite(risks[1:]).all()


def test_success_bound_of_hundreds_of_members_compares_choices_of_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compared: list[int] = []

    def together(_task: object, members: int, *_levels: float) -> float:
        compared.append(members)
        return 1.0

    monkeypatch.setattr(level_game, "_together", together)
    many = [[0.01 * k, 0.0] for k in range(300)]
    scenario = load_scenario("paper-1").replace(swarm={"positions": many})
    bound = success_bound(scenario, max_work=1e6)
    assert set(compared) == {64}
    assert bound.certified

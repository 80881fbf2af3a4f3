"""Hazards in time: keys, known answers, images, independent recursions, and refusals by name."""

import pickle
import tomllib
from itertools import product

import numpy as np
import pytest

import casswarm as csw
from casswarm.errors import CasswarmError, HazardError, ScenarioError
from casswarm.grid import ValueFunction
from casswarm.hazard.codegen import _lowered
from casswarm.hazard.compiled_rates import _module

DT, N = 0.5, 6
LINE = {
    "name": "line",
    "swarm": {"positions": [[0.0, 0.0]], "v_max": 2.0, "a_max": 100.0},
    "target": {"center": [4.0, 0.0], "radius": 0.25},
    "time": {"dt": DT, "t_f": DT * N},
    "hazard": {"kind": "saturation", "alpha_1": 2.0, "alpha_2": 3.0, "alpha_3": 4.0},
}
MOVING = {"position": [2.0, 1.0], "velocity": [0.3, -0.2], "strength": 2.0}


def scenario(*radars, members=((0.0, 0.0),), **hazard):
    data = {**LINE, "swarm": {**LINE["swarm"], "positions": members}}
    data["hazard"] = {**LINE["hazard"], "radar": list(radars), **hazard}
    return csw.Scenario.from_data(data)


@pytest.mark.parametrize(
    ("radar", "message"),
    [
        ({"strength": 2.0}, "hazard.radar[0].position is missing"),
        (
            {"path": [[0, 1, 1.0]], "velocity": [1.0, 0]},
            "hazard.radar[0].velocity and hazard.radar[0]",
        ),
        (
            {"path": [[0, 1, 1.0], [0, 2, 1.0]]},
            "hazard.radar[0].path has a waypoint at time 0 after",
        ),
        ({**MOVING, "active": [[2.0, 1.0]]}, "hazard.radar[0].active has [2, 1]"),
        ({**MOVING, "active": [[0.0, 2.0], [1.0, 3.0]]}, "must not overlap"),
        (
            {**MOVING, "strength": 0.0},
            "hazard.radar[0].strength is 0.0; it must be a number above 0",
        ),
        ({**MOVING, "path": [[0, np.inf, 0]]}, "hazard.radar[0].path[0][1] is inf"),
        ({**MOVING, "speed": 1.0}, "unknown key 'hazard.radar[0].speed'"),
        ({**MOVING, "velocty": [1.0, 0.0]}, "did you mean 'hazard.radar[0].velocity'?"),
        ({"position": [0.0, 0.001]}, "on hazard.radar[0]; move one of them"),
    ],
)
def test_radar_in_time_with_a_wrong_key_is_refused_by_its_name(radar, message):
    with pytest.raises(ScenarioError) as error:
        scenario(radar)
    assert message in str(error.value)


def test_more_radars_than_the_limit_are_refused_by_name():
    with pytest.raises(ScenarioError, match=r"hazard\.radar .*at most 1000"):
        scenario(*[{"position": [1.0, 1.0]}] * 1001)


@pytest.mark.parametrize("name", ["blink", "patrol"])
def test_scenario_with_radars_in_time_survives_toml_comments_and_pickling(name):
    original = csw.load_scenario(name)
    for comments in (False, True):
        assert csw.Scenario.from_data(tomllib.loads(original.to_toml(comments))) == original
    assert "# Waypoints [time, x, y], straight between them" in original.to_toml(True)
    assert all(len(line) <= 100 for line in original.to_toml(True).splitlines())
    copy = pickle.loads(pickle.dumps(original))
    assert (copy, hash(copy)) == (original, hash(original))
    assert f"{len(original.hazard_table.radar)} radars" in repr(original)


def test_position_and_strength_of_a_radar_follow_path_velocity_and_intervals():
    path = {"path": [[1.0, 0.0, 0.5], [2.0, 2.0, 0.5]], "active": [[0.0, 1.0], [1.5, 2.0]]}
    hazard = scenario(path, {**MOVING, "position": [2.0, 1.5]}, radars=[[9.0, 9.0]]).hazard
    for time, x, strength in [
        (0.5, 0.0, 1),
        (1.0, 0.0, 1),
        (1.5, 1.0, 0),
        (2.0, 2.0, 1),
        (3.0, 2.0, 0),
    ]:
        at = hazard.at(time)
        expected = [[9.0, 9.0], [x, 0.5], [2.0 + 0.3 * time, 1.5 - 0.2 * time]]
        np.testing.assert_allclose(at.radar_positions, expected, rtol=1e-15)
        assert at.radar_strengths.tolist() == [1.0, strength, 2.0]


def test_rates_of_a_batch_at_its_own_times_are_those_of_each_time():
    hazard, rng = scenario(MOVING).hazard, np.random.default_rng(0)
    states, times = rng.normal(size=(5, 3, 2)), np.array([0.5, 1.0, 0.5, 2.0, 0.0])
    together = hazard.rates(states, time=times)
    for state, time, rates in zip(states, times, together, strict=True):
        squares = ((state - [2.0 + 0.3 * time, 1.0 - 0.2 * time]) ** 2).sum(axis=1)
        pairs = ((state[:, None] - state) ** 2).sum(axis=-1)
        density = (1 / (1 + 4.0 * pairs)).sum(axis=1)
        np.testing.assert_allclose(rates, 2.0 * 2.0 / squares / (1 + 3.0 * density), rtol=1e-12)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([MOVING, {"position": [1.0, 1.0], "active": []}], [MOVING]),
        ([{**MOVING, "active": [[0.0, 1.5]]}, {**MOVING, "active": [[1.5, 9.0]]}], [MOVING]),
        ([{"position": [2.0, 1.0], "velocity": [0.0, 0.0]}], [{"position": [2.0, 1.0]}]),
    ],
    ids=["never active is absent", "two half-time radars are one", "velocity 0 is at rest"],
)
def test_guide_of_an_equivalent_hazard_in_time_is_the_same_to_the_last_bit(one, other):
    guides = [csw.plan(scenario(*radars), certify=False) for radars in (one, other)]
    assert np.array_equal(guides[0].positions, guides[1].positions)
    assert guides[0].risk == guides[1].risk


def brute_force(steps, rate):
    """Least risk over all paths on a lattice on a line to its node 4, by recursion on (t, x)."""

    def least(t, x):
        if x == 4:
            return 0.0
        if t == steps:
            return np.inf
        options = range(x - 1, x + 2)
        return min(DT * rate(t + 1, y) + least(t + 1, y) for y in options if -2 <= y <= 4)

    return least(0, 0)


def test_value_function_and_certificate_enclose_the_least_risk_of_brute_force():
    switching = {"position": [2.0, 0.3], "active": [[0.0, 1.5], [2.5, 3.0]]}
    one = scenario(switching)
    active = {t: t * DT <= 1.5 or t * DT > 2.5 for t in range(N + 1)}
    least = brute_force(N, lambda t, x: active[t] * 0.5 / ((x - 2.0) ** 2 + 0.3**2))
    value = ValueFunction.from_scenario(one)
    low, high = value.bounds(0, [[0.0, 0.0]])
    guide = csw.plan(one)
    assert low[0] <= guide.risk + 1e-9
    assert guide.risk_bound <= guide.risk <= least + 1e-9  # the plane has more paths than the line
    assert high[0] <= least + 1e-9
    assert guide.arrival > 4  # waits for the radar, though it could arrive in four steps


@pytest.mark.parametrize("radar", [MOVING, MOVING | {"active": [[0.0, 1.0]]}])
def test_certificate_with_a_max_is_below_all_paths_of_changes_in_twelve_directions(radar):
    steps, change, first = 5, 1.0, np.array([1.0, 0.0])
    limited = {"a_max": change**2, "velocity": first.tolist()}
    one = scenario(radar).replace(swarm=limited, time={"t_f": steps * DT})
    angles = np.arange(12) * np.pi / 6
    controls = change * np.vstack([[0.0, 0.0], np.column_stack([np.cos(angles), np.sin(angles)])])
    velocities, positions = first[None], np.zeros((1, 2))
    risk, least = np.zeros(1), np.inf
    for step in range(1, steps + 1):
        velocities = (velocities[:, None] + (1 - 1e-9) * controls).reshape(-1, 2)
        allowed = np.abs(velocities).max(axis=1) <= 2.0
        positions = np.repeat(positions, 13, axis=0)[allowed] + DT * velocities[allowed]
        velocities, time = velocities[allowed], step * DT
        away = positions - np.array(MOVING["position"]) - time * np.array(MOVING["velocity"])
        on = any(begin < time <= end for begin, end in radar.get("active", [[0.0, 9.0]]))
        risk = np.repeat(risk, 13)[allowed] + DT * on * 2.0 * 0.5 / (away**2).sum(axis=1)
        inside = np.hypot(*(positions - [4.0, 0.0]).T) <= 0.25
        least = min(least, risk[inside].min(initial=np.inf))
    guide = csw.plan(one, gap=0.005)
    assert guide.risk_bound <= guide.risk <= least + 1e-9
    assert guide.risk_bound >= 0.99 * guide.risk
    assert guide.certificate.accelerated is not None or guide.certificate.gap <= 0.005


def law(one, policy):
    """Probability of success, from the equations alone: a recursion over losses and steps."""
    hazard, dt = one.hazard_table, one.time.dt
    radar = hazard.radar[0]

    def rates(time, x, alive):
        center = np.array(radar.position) + np.array(radar.velocity) * time
        on = any(a < time <= b for a, b in radar.active)
        density = sum(
            a / (1 + hazard.alpha_3 * ((x - y) ** 2).sum(axis=1))
            for a, y in zip(alive, x, strict=True)
        )
        return (
            on * hazard.alpha_1 / ((x - center) ** 2).sum(axis=1) / (1 + hazard.alpha_2 * density)
        )

    def success(step, x, v, alive):
        if not any(alive) or step == one.n_steps:
            return 0.0
        command = policy.velocities(step, x, v, alive)
        following = x + dt * command
        survival = np.exp(-dt * rates((step + 1) * dt, following, alive))
        total = 0.0
        for each in product(*[(True, False) if a else (False,) for a in alive]):
            kept = np.array(each)
            weight = np.where(kept, survival, 1 - survival)[alive].prod()
            arrived = kept & (np.hypot(*(following - one.target.center).T) <= one.target.radius)
            if weight > 0:
                total += weight * (arrived.any() or success(step + 1, following, command, kept))
        return total

    x = one.positions
    return success(0, x, np.tile(policy.guide.velocities[0], (len(x), 1)), np.ones(len(x), bool))


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_exact_and_sampled_success_agree_with_a_recursion_of_the_equations(name):
    radar = {"position": [2.0, 0.6], "velocity": [0.2, 0.0], "active": [[0.0, 1.0], [1.5, 9.0]]}
    one = scenario(radar, members=[[0.0, 0.0], [0.0, 0.3]])
    guide = csw.plan(one, certify=False)
    expected = law(one, csw.make_policy(name, one, guide=guide))
    exact = csw.evaluate(one, name, guide=guide)
    assert exact.success.low - 1e-6 <= expected <= exact.success.high + 1e-6
    sampled = csw.simulate(one, [name], runs=2000, guide=guide, save_trajectories=0)
    error = np.sqrt(expected * (1 - expected) / 2000)
    assert abs(sampled.summary.success[0] - expected) < 4 * error
    assert csw.success_bound(one, max_work=1e6).value >= expected


IMAGES = {
    "quarter turn": np.array([[0.0, -1.0], [1.0, 0.0]]),
    "mirror": np.diag([1.0, -1.0]),
    "units": None,
}


@pytest.mark.parametrize("image", IMAGES)
def test_guide_of_an_image_of_a_hazard_in_time_is_the_image_of_the_guide(image):
    path = {"path": [[0.0, 2.0, 1.0], [3.0, 2.5, -1.0]], "active": [[0.0, 1.0], [1.5, 9.0]]}
    one = scenario(path, MOVING)
    matrix, clock, length = IMAGES[image], 1.0, 1.0
    if matrix is None:
        matrix, clock, length = 8.0 * np.eye(2), 0.25, 8.0
    radars = [
        radar.mapped(lambda points: np.asarray(points) @ matrix.T)
        for radar in one.hazard_table.radar
    ]
    radars[0]["path"] = np.array(radars[0]["path"]) * [clock, 1, 1]
    radars[0]["active"] = clock * np.array(radars[0]["active"])
    radars[1]["velocity"] = np.array(radars[1]["velocity"]) / clock
    other = one.with_values(
        {
            "hazard.radar": radars,
            "target.center": matrix @ one.target.center,
            "target.radius": length * one.target.radius,
            "time.dt": clock * one.time.dt,
            "time.t_f": clock * one.time.t_f,
            "swarm.v_max": length / clock * one.swarm.v_max,
            "swarm.a_max": (length / clock) ** 2 * one.swarm.a_max,
            "hazard.alpha_1": length**2 / clock * one.hazard_table.alpha_1,
            "hazard.alpha_3": one.hazard_table.alpha_3 / length**2,
            "formation.rho": length**2 * one.formation.rho,
        }
    )
    guides = [csw.plan(each, certify=False) for each in (one, other)]
    np.testing.assert_allclose(
        guides[1].positions, guides[0].positions @ matrix.T, atol=1e-5 * length
    )
    assert guides[1].risk == pytest.approx(guides[0].risk, rel=1e-8)


def surveillance(positions, alive, time):
    """Rate 1 / (r^2 + 0.1) of two observers on circles: arXiv 1903.01332, its first example."""
    angle = 2 * np.pi * time
    centers = (
        (0.3 + 0.12 * np.cos(angle), 0.8 + 0.12 * np.sin(angle)),
        (
            0.9 - 0.08 * np.cos(angle),
            0.1 - 0.08 * np.sin(angle),
        ),
    )
    squares = [(positions[:, 0] - x) ** 2 + (positions[:, 1] - y) ** 2 for x, y in centers]
    return alive * sum(1 / (square + 0.1) for square in squares)


def test_guide_with_a_custom_rate_of_time_is_no_worse_than_paths_on_a_grid():
    data = {
        **LINE,
        "swarm": {"positions": [[0.1, 0.1]], "v_max": 1.0, "a_max": 100.0},
        "target": {"center": [0.9, 0.9], "radius": 0.01},
        "time": {"dt": 0.1, "t_f": 1.6},
        "hazard": {**LINE["hazard"], "radars": [[5.0, 5.0]]},
    }
    one = csw.Scenario.from_data(data).with_hazard(surveillance)
    guide = csw.plan(one, certify=False)
    axis = 0.1 * np.arange(11)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    goal = (9, 9)
    to_go = np.full((11, 11), np.inf)
    to_go[goal] = 0.0
    for step in range(16, 0, -1):  # backwards, each node from the best of its nine neighbours
        angle = 2 * np.pi * 0.1 * step
        one_center = np.array([0.3 + 0.12 * np.cos(angle), 0.8 + 0.12 * np.sin(angle)])
        other = np.array([0.9 - 0.08 * np.cos(angle), 0.1 - 0.08 * np.sin(angle)])
        rate = sum(1 / (((nodes - c) ** 2).sum(axis=-1) + 0.1) for c in (one_center, other))
        padded = np.pad(to_go + 0.1 * rate, 1, constant_values=np.inf)
        to_go = np.min([padded[i : i + 11, j : j + 11] for i in range(3) for j in range(3)], axis=0)
        to_go[goal] = 0.0
    assert guide.arrives
    assert guide.risk <= to_go[1, 1] + 1e-6
    hazard = one.hazard
    assert guide.risk == pytest.approx(
        sum(
            0.1 * hazard.single_agent_rates(x, time=0.1 * t)
            for t, x in enumerate(guide.positions[1:], 1)
        )
    )


def test_timing_decides_in_blink_and_patrol():
    for name, ratio in (("blink", 0.6), ("patrol", 0.9)):
        one = csw.load_scenario(name)
        guide = csw.plan(one, certify=False)
        earliest = min(c.arrival for c in guide.candidates if np.isfinite(c.risk))
        assert guide.arrival > earliest
        fastest = min(c.risk for c in guide.candidates if c.arrival == earliest)
        assert np.exp(-fastest) < ratio * guide.survival


REFUSED = {
    "rate without a time": lambda one: one.hazard.rates(one.positions),
    "single-agent rate": lambda one: one.hazard.single_agent_rates(one.positions),
    "rates of sets": lambda one: one.hazard.set_rates(one.positions[None], np.ones((1, 2), bool)),
    "expression": lambda one: one.hazard.single_agent_expression(one.positions.T),
    "bound of rates": lambda one: one.hazard.single_agent_rates_below(
        np.zeros(2), np.zeros(2), 1.0
    ),
}


@pytest.mark.parametrize("part", REFUSED)
def test_parts_that_do_not_treat_time_refuse_with_the_key_and_their_name(part):
    one = scenario(MOVING, members=[[0.0, 0.0], [0.0, 0.3]])
    with pytest.raises(
        HazardError,
        match=r"^hazard\.radar: its radars move or switch, (and|so) .* (does not|is not defined)",
    ) as error:
        REFUSED[part](one)
    assert error.value.key == "hazard.radar"
    assert error.value.part
    assert isinstance(error.value, CasswarmError)


@pytest.mark.slow
def test_kernels_are_derived_once_for_all_times():
    fine = csw.load_scenario("patrol").refined(8)
    guide = csw.plan(fine, certify=False, search="local")
    before = _lowered.cache_info().misses + _module.cache_info().misses
    csw.simulate(fine, "leader", 20, guide=guide)
    csw.evaluate(fine, "constrained", 0.1, guide=guide)
    after = _lowered.cache_info().misses + _module.cache_info().misses
    assert after - before <= 4  # of 112 steps
    hazards = [fine.hazard.after(step) for step in (1, 50, 112)]
    assert len({h.radars for h in hazards}) == 3
    assert len({h.template for h in hazards}) == 1
    assert pickle.loads(pickle.dumps(hazards[1])).template == hazards[1].template

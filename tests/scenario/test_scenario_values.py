"""Wrong values of scenarios, and tables that contradict each other."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenario_messages import message

from casswarm.scenario import Scenario, Time


def test_many_problems_are_truncated(paper: Scenario) -> None:
    text = message(paper.with_values, {"swarm.positions": [["a", 0]] * 100})
    assert len(text.splitlines()) == 22
    assert "... and 80 more" in text


WRONG_VALUES = [  # KEY in the words stands for the key
    ("swarm.v_max", True, "KEY is true; it must be a number above 0"),
    ("swarm.v_max", "fast", "KEY is 'fast'; it must be a number above 0"),
    ("swarm.v_max", 0, "KEY is 0; it must be a number above 0"),
    ("swarm.v_max", math.nan, "KEY is nan; it must be a number above 0"),
    ("swarm.v_max", math.inf, "KEY is inf; it must be a number above 0"),
    ("swarm.v_max", 1e300, "KEY is 1e+300; it must be a number above 0"),
    ("swarm.v_max", 10**400, "0000...; it must be a number above 0"),
    ("swarm.v_max", 10**5000, "KEY is a number of thousands of digits; it must be"),
    ("swarm.a_max", -0.5, "KEY is -0.5; it must be a number above 0"),
    ("swarm.positions", [], "at least one"),
    ("swarm.positions", 1.0, "KEY is 1.0; it must be a list of [x, y] pairs"),
    ("swarm.positions", [[0, 0], [1]], "KEY[1] is [1]; KEY must be a list"),
    ("swarm.positions", [[0, 0, 0]], "KEY[0] is [0, 0, 0]; KEY must be"),
    ("swarm.positions", [[0, "a"]], "KEY[0][1] is 'a'; KEY must be"),
    ("swarm.positions", [[0, 1e21]], "KEY[0][1] is 1e+21; KEY"),
    ("swarm.velocity", "slow", "KEY is 'slow'; it must be 'guide', or [vx, vy]"),
    ("swarm.velocity", [1, "a"], "KEY is [1, 'a']; it must be 'guide', or [vx, vy]"),
    ("target.center", [1], "KEY is [1]; it must be [x, y], two numbers"),
    ("target.radius", 0.0, "KEY is 0.0; it must be a number above 0"),
    ("hazard.alpha_2", -1, "KEY is -1; it must be a number, 0 or above"),
    ("hazard.alpha_3", 0, "KEY is 0; it must be a number above 0"),
    ("hazard.strengths", [1, -1], "KEY[1] is -1; KEY must be a list"),
    ("hazard.kind", 3, "KEY is 3; it must be 'saturation', 'saturation+collision', or"),
    ("hazard.parameters", 3, "KEY is 3; it must be a table of numbers"),
    ("guide.search", "wide", "KEY is 'wide'; it must be 'local' or 'global'"),
    ("guide.acceleration_limited", 1, "KEY is 1; it must be true or false"),
    ("guide.iterations", 0, "KEY is 0; it must be a whole number from 1"),
    ("guide.iterations", 10.0, "KEY is 10.0; it must be a whole number from 1"),
    ("guide.arrival", "soon", "KEY is 'soon'; it must be 'any' or 'horizon'"),
    ("guide.margin", -0.1, "KEY is -0.1; it must be a number, 0 or above"),
    ("name", "", "KEY is ''; it must be a text of 1 to 100 printable characters, without slashes"),
    ("name", "../up", "KEY is '../up'; it must be a text of 1 to 100 printable characters"),
    ("name", 1, "KEY is 1; it must be a text of 1 to 100 printable characters"),
    ("description", 1, "KEY is 1; it must be a text in quotes"),
    ("gide.xyz", 1, "unknown key 'gide'; did you mean 'guide'?"),
    ("target.center", [0.8, 0.6], "swarm.positions[1] is [0.45, 0.45], inside the target zone"),
    ("time.t_f", 0.2, "KEY is 0.2 with dt = 0.33, less than one step; raise t_f to 0.33 or more"),
    ("time.dt", 1e-9, "1e+10 steps; at most 100000 are allowed, raise dt"),
    ("guide.margin", 0.5, "KEY is 0.5; it must be below target.radius = 0.5"),
    (
        "hazard.kind",
        "satturation",
        "KEY is 'satturation'; it must be 'saturation', 'saturation+collision'",
    ),
    ("hazard.kind", "satturation", "did you mean 'saturation'?"),
    ("hazard.beta_1", 0.2, "KEY is not a key of kind 'saturation'; remove it, or choose kind"),
    ("hazard.parameters.a", 1, "hazard.parameters is not a key of kind 'saturation'"),
    ("hazard.radars", [], "KEY is missing or empty; kind 'saturation' needs [x, y] pairs"),
    ("hazard.radars", None, "KEY is missing or empty; kind 'saturation' needs [x, y] pairs"),
    ("hazard.strengths", [1, 2, 3], "KEY has 3 numbers for 2 radars; give one for each radar"),
    ("time", 3, "KEY is 3; it must be a table with the keys dt, t_f"),
]


@pytest.mark.parametrize(
    ("key", "value", "words"), WRONG_VALUES, ids=lambda item: item if isinstance(item, str) else ""
)
def test_wrong_value_reports_allowed_values(
    paper: Scenario, key: str, value: object, words: str
) -> None:
    assert words.replace("KEY", key) in message(paper.with_values, {key: value})


# --- several values at once, which contradict each other


CLOCK = {"time.dt": 1.0, "time.t_f": 5.0, "target.radius": 1.0}
FAR = 10 + math.sqrt(0.5) + 1e-6
ON_RADAR = {"hazard.radars": [[3, 3], [0.45, 0.455]]}
WRONG_TOGETHER: dict[str, tuple[dict[str, object], *tuple[str, ...]]] = {
    "unknown keys": (
        {"formation.ro": 0.1, "swarm.vmax": 1.0},
        "unknown key 'formation.ro'; did you mean 'formation.rho'?",
        "unknown key 'swarm.vmax'; did you mean 'swarm.v_max'?",
        "'paper-1'",
    ),
    "no table": (
        {"swarm": 3, "swarm.v_max": 1.0},
        "swarm.v_max cannot be set: swarm is 3, not a table of keys",
    ),
    "member on radar": (
        ON_RADAR,
        "swarm.positions[1] is [0.45, 0.45], on hazard.radars[1]; move one of them",
        "0.01 or more apart (hazard.core_radius)",
    ),
    "member in core of a fiftieth": (
        {"hazard.radars": [[3, 3], [0.45, 0.475]], "target.radius": 2.0},
        "0.04 or more apart",
    ),
    "target out of reach": (
        {"target.center": [30.5, 0.0], "time": {"dt": 1, "t_f": 10}},
        "target.center is [30.5, 0.0], out of reach: from the guide's start [0.0, 0.0] the "
        "distance along an axis is 30, and 10 steps of dt * v_max = 2 cover 20",
        "the fastest path takes 15 steps: raise time.t_f to 15 or more",
    ),
    "corner out of reach": ({**CLOCK, "target.center": [FAR, FAR]}, "out of reach"),
    "other corner": (
        {**CLOCK, "target.center": [-FAR, FAR]},
        "takes 6 steps: raise time.t_f to 6 or more",
    ),
    "velocity": (
        {"swarm.velocity": [0.0, -2.5]},
        "swarm.velocity is [0.0, -2.5]; each component may be at most swarm.v_max = 2",
    ),
}


@pytest.mark.parametrize("case", WRONG_TOGETHER)
def test_wrong_values_together_are_named(paper: Scenario, case: str) -> None:
    changes, *words = WRONG_TOGETHER[case]
    text = message(paper.with_values, changes)
    assert [part for part in words if part not in text] == []


def test_replace_of_unknown_key_suggests_closest(paper: Scenario) -> None:
    assert "did you mean 'formation.rho'?" in message(paper.replace, formation={"ro": 0.1})


def test_smaller_core_allows_member_near_radar(paper: Scenario) -> None:
    near = paper.with_values({**ON_RADAR, "hazard.core_radius": 0.001})
    assert near.hazard.core_radius == 0.001


@given(st.integers(1, 50_000), st.integers(1, 10**6), st.integers(0, 6))
def test_steps_end_by_t_f(steps: int, digits: int, decimals: int) -> None:
    dt = digits / 10**decimals
    for t_f in (steps * dt, float(Fraction(steps * digits, 10**decimals))):
        assert Time(dt=dt, t_f=t_f).steps == steps
        assert Time(dt=dt, t_f=t_f * (1 - 1e-10)).steps == steps - 1

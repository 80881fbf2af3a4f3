"""Scenarios that are saved load as equal scenarios."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from casswarm.scenario import Scenario, load_scenario, save_scenario


def floats(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


coordinates = floats(-100, 100)
points = st.tuples(coordinates, coordinates)
positive = floats(1e-3, 1e3)
letters = st.characters(categories=["L", "N"], max_codepoint=127)
others = st.characters(exclude_categories=["C", "Zl", "Zp"], exclude_characters="/\\$")
names = st.builds(str.__add__, letters, st.text(others, max_size=30))
parameters = st.recursive(
    st.booleans() | st.integers(-(2**62), 2**62) | floats(-1e300, 1e300) | st.text(),
    lambda children: st.lists(children, max_size=3),
    max_leaves=5,
)


@st.composite
def hazard_tables(draw: st.DrawFn) -> dict[str, Any]:
    kind = draw(st.sampled_from(["saturation", "saturation+collision", "custom"]))
    radars = draw(st.lists(points, min_size=kind != "custom", max_size=4))
    if kind == "custom":
        chosen = draw(st.dictionaries(st.text().filter(lambda key: key != "radars"), parameters))
        kind = f"{__name__}:takes_anything"
        return {"kind": kind, "radars": radars, "parameters": chosen}
    table: dict[str, Any] = {"kind": kind, "radars": radars}
    k = len(radars)
    table["strengths"] = draw(st.none() | st.lists(positive, min_size=k, max_size=k))
    table |= {"alpha_1": draw(positive), "alpha_2": draw(floats(0, 10)), "alpha_3": draw(positive)}
    if kind != "saturation":
        table |= {"beta_1": draw(floats(0.01, 1)), "beta_2": draw(floats(0.5, 10))}
    table["core_radius"] = draw(st.none() | floats(0.001, 0.1))
    return {key: value for key, value in table.items() if value is not None}


def takes_anything(positions: Any, alive: Any, **_: object) -> Any:  # noqa: ARG001
    return 0 * positions[:, 0]


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    velocity = draw(st.just("guide") | st.tuples(floats(-1, 1), floats(-1, 1)))
    guide: dict[str, Any] = {"acceleration_limited": draw(st.booleans()), "gamma": draw(positive)}
    for key, values in {"a_max": positive, "margin": floats(0, 0.005)}.items():
        value = draw(st.none() | values)
        guide |= {} if value is None else {key: value}
    guide["arrival"] = draw(st.sampled_from(["any", "horizon"]))
    data: dict[str, Any] = {
        "name": draw(names),
        "description": draw(st.text()),
        "swarm": {
            "positions": draw(st.lists(points, min_size=1, max_size=4)),
            "velocity": velocity,
            "v_max": draw(floats(1, 1e3)),
            "a_max": draw(positive),
        },
        "target": {"center": draw(points), "radius": draw(floats(0.01, 10))},
        "time": {"dt": draw(floats(0.01, 1)), "t_f": draw(floats(200, 400))},
        "hazard": draw(hazard_tables()),
        "guide": guide,
        "formation": {"rho": draw(positive), "iterations": draw(st.integers(1, 10**9))},
    }
    radars, center = data["hazard"]["radars"], data["target"]["center"]
    for position in data["swarm"]["positions"]:
        assume(math.dist(position, center) > data["target"]["radius"] + 1e-6)
        assume(all(math.dist(position, radar) > 0.2 for radar in radars))
    return Scenario.from_data(data, allow_code=True)


@pytest.mark.slow
@settings(deadline=None, max_examples=150)
@given(scenario=scenarios())
def test_saved_scenario_loads_as_equal(
    scenario: Scenario, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "round-trip.toml"
    beside = path.with_name(f"{__name__}.py")
    beside.write_text(
        "def takes_anything(positions, alive, **_):\n    return 0 * positions[:, 0]\n"
    )
    save_scenario(scenario, path)
    assert load_scenario(path, allow_code=True) == scenario
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    assert scenario.with_values({}) == scenario


@pytest.mark.parametrize("comments", [False, True])
@pytest.mark.parametrize("text", ["a\u2028b\u0085c\nd", "a\ufeffb\u200d\U000e0001é🙂"])
def test_saved_description_of_odd_characters_shows_them_and_loads_as_equal(
    comments: bool, text: str, tmp_path: Path
) -> None:
    scenario, path = (
        load_scenario("paper-1").with_values({"description": text}),
        tmp_path / "s.toml",
    )
    save_scenario(scenario, path, comments=comments)
    assert load_scenario(path) == scenario
    saved = path.read_text(encoding="utf-8")
    assert all(line.isprintable() for line in saved.split("\n"))
    assert ("é🙂" in saved) == ("é🙂" in text)

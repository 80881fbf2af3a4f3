"""Scenarios as objects and as arguments."""

from __future__ import annotations

import math
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_names import BUILTIN
from scenario_messages import message

import casswarm as csw
from casswarm.errors import ScenarioError
from casswarm.hazard import Saturation, SaturationCollision
from casswarm.scenario import (
    HazardTable,
    Scenario,
    Swarm,
    Target,
    Time,
    builtin_scenarios,
    load_scenario,
    save_scenario,
)

# --- what a scenario holds


def test_paper_1_has_the_values_of_table_1(paper: Scenario) -> None:
    assert (paper.n, paper.n_steps) == (5, 30)
    assert (paper.swarm.v_max, paper.swarm.a_max, paper.swarm.velocity) == (2.0, 0.5, "guide")
    assert (paper.guide.gamma, paper.guide.learning_rate, paper.guide.iterations) == (
        10,
        0.05,
        6000,
    )
    assert (paper.formation.rho, paper.formation.iterations) == (0.05, 2000)
    assert (paper.guide.search, paper.guide.a_max, paper.guide.acceleration_limited) == (
        "local",
        0.1,
        True,
    )
    radars = ((6.8, 3.5), (6.4, 1.7))
    assert paper.hazard == Saturation(radars=radars, alpha_1=4.0, alpha_2=3.0, alpha_3=4.0)


def test_paper_2_equals_paper_1_with_collisions(paper: Scenario) -> None:
    betas = {"hazard.kind": "saturation+collision", "hazard.beta_1": 0.2, "hazard.beta_2": 6}
    other = load_scenario("paper-2")
    names = {"name": other.name, "description": other.description}
    assert paper.with_values({**names, **betas}) == other
    assert isinstance(other.hazard, SaturationCollision)


@pytest.mark.parametrize("name", BUILTIN)
def test_builtin_scenario_loads_with_description(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert len(scenario.description) > 20
    assert "\n" not in scenario.description
    for case in scenario.cases:
        hazard = case.scenario.hazard
        rates = hazard.rates(scenario.positions, np.ones(scenario.n, bool), time=0.0)
        assert rates.shape == (scenario.n,)
        assert (rates < 1).all()


def test_builtin_scenarios_lists_descriptions() -> None:
    listed = builtin_scenarios()
    folder = Path(str(files("casswarm.scenario"))) / "builtin"
    assert list(listed) == sorted(file.stem for file in folder.glob("*.toml"))
    assert len(listed) >= 10
    assert listed == {name: load_scenario(name).description for name in BUILTIN}


@pytest.mark.parametrize(
    ("t_f", "dt", "steps"),
    [(10, 0.33, 30), (1.0, 0.1, 10), (0.3, 0.1, 3), (0.99, 0.1, 9), (7, 1, 7), (0.33, 0.33, 1)],
)
def test_steps_are_counted_without_rounding_errors(t_f: float, dt: float, steps: int) -> None:
    assert Time(t_f=t_f, dt=dt).steps == steps


CLOCK = {"time.dt": 1.0, "time.t_f": 5.0, "target.radius": 1.0}
NEAR = 10 + math.sqrt(0.5) - 1e-6
PAIR = {"swarm.positions": [[0.1, 0.3], [0.1, 0.1]]}
DERIVED: list[tuple[str, dict[str, Any], str, object]] = [
    ("single-agent", {}, "n", 1),
    ("large-swarm", {}, "n", 50),
    ("crossfire", {}, "hazard_table.strengths", (2.0,) * 3 + (0.5,) * 3),
    ("gauntlet", {}, "hazard_table.kind", "saturation+collision"),
    ("paper-1", {"swarm.positions": [[0, 0], [0, 0]]}, "n", 2),
    ("paper-1", {"hazard.alpha_2": 0}, "hazard_table.alpha_2", 0),
    ("paper-1", {"swarm.velocity": [2, -2]}, "swarm.velocity", (2.0, -2.0)),
    ("paper-1", {**CLOCK, "target.center": [NEAR, NEAR]}, "n_steps", 5),  # reach is a square
    ("paper-1", {**CLOCK, "target.center": [11.0, 0.0]}, "n_steps", 5),
    # the guide starts at the member nearest to the centroid, the first one of several
    (
        "paper-1",
        {"swarm.positions": [[0.5, 0], [0, 0.5], [0, 0], [-0.5, 0]]},
        "guide_start",
        [0, 0],
    ),
    ("paper-1", PAIR, "guide_start", [0.1, 0.3]),  # rounding alone would prefer one of the two
    ("paper-1", {"swarm.positions": [[1, 1], [1, 1]]}, "guide_start", [1, 1]),
    # limits of the guide are those of members by default
    ("paper-1", {}, "guide_a_max", 0.1),
    ("paper-1", {"guide.a_max": None}, "guide_a_max", 0.5),
    ("paper-1", {"guide.acceleration_limited": False}, "guide_a_max", math.inf),
    # the margin of the arrival is the corridor or half the radius, negligible for one member
    ("paper-1", {}, "guide.margin", None),
    ("paper-1", {}, "arrival_margin", math.sqrt(0.05)),
    ("paper-1", {"formation.rho": 1.0}, "arrival_margin", 0.25),
    ("paper-1", {"target.radius": 0.2}, "arrival_margin", 0.1),
    ("single-agent", {}, "arrival_margin", pytest.approx(5e-7)),
    ("paper-1", {"swarm.positions": [[0, 0]]}, "arrival_margin", pytest.approx(5e-7)),
    ("paper-1", {"guide.margin": 0.05}, "arrival_margin", 0.05),
    ("paper-1", {}, "guide.arrival", "horizon"),
    ("paper-2", {}, "guide.arrival", "horizon"),
    ("paper-1", {"guide.arrival": None}, "guide.arrival", "any"),
    ("wall", {}, "guide.arrival", "any"),
]


@pytest.mark.parametrize(("name", "changes", "attribute", "expected"), DERIVED)
def test_scenario_has_derived_value(
    name: str, changes: dict[str, Any], attribute: str, expected: object
) -> None:
    found = attrgetter(attribute)(load_scenario(name).with_values(changes))
    assert (found.tolist() if isinstance(found, np.ndarray) else found) == expected


def test_arrays_are_read_only(paper: Scenario) -> None:
    for array in (paper.positions, paper.guide_start):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("table", "key", "words"),
    [
        ("", "name", "scenario.with_values({'name': ...})"),
        ("formation", "rho", "with_values({'formation.rho': ...})"),
        ("hazard_table", "alpha_1", "hazard.alpha_1 cannot be set; a changed copy is"),
    ],
)
def test_scenario_is_frozen(paper: Scenario, table: str, key: str, words: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(words)):
        setattr(getattr(paper, table) if table else paper, key, 1.0)


def test_scenario_from_tables_has_default_options() -> None:
    scenario = Scenario(
        name="mine",
        swarm=Swarm(positions=np.zeros((2, 2)), v_max=np.float64(2), a_max=1),
        target=Target(center=(3, 0), radius=0.5),
        time=Time(dt=1, t_f=5),
        hazard=HazardTable(kind="saturation", radars=[(1, 1)], alpha_1=1, alpha_2=0, alpha_3=1),
    )
    assert scenario.swarm.positions == ((0.0, 0.0), (0.0, 0.0))
    assert (scenario.guide.search, scenario.guide.iterations) == ("global", 6000)
    assert type(scenario.swarm.v_max) is float
    assert "2 members, 1 radar, saturation hazard, 5 steps" in repr(scenario)


def test_table_with_wrong_values_lists_every_problem() -> None:
    text = message(Swarm, positions=[], v_max=-1.0, a_mx=3)
    assert text.splitlines() == [
        "invalid Swarm:",
        "  positions is []; it must be a list of [x, y] pairs of numbers, one for each member, "
        "at least one",
        "  v_max is -1.0; it must be a number above 0 (from 1e-20 to 1e+20)",
        "  a_max is missing; it must be a number above 0 (from 1e-20 to 1e+20)",
        "  unknown key 'a_mx'; did you mean 'a_max'?",
    ]


def test_schema_describes_every_key() -> None:
    schema = Scenario.model_json_schema()
    for table in [schema, *schema["$defs"].values()]:
        for key, entry in table["properties"].items():
            assert entry.get("description"), key


def test_scenario_import_does_not_import_casadi() -> None:
    code = "import sys, casswarm.scenario as s; s.builtin_scenarios(); s.load_scenario('paper-1')"
    check = f"{code}; sys.exit('casadi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0


# --- equality and copies


def test_scenarios_with_equal_values_are_equal(paper: Scenario, tmp_path: Path) -> None:
    save_scenario(paper, tmp_path / "my.toml")
    loaded = load_scenario(tmp_path / "my.toml")
    assert loaded == paper
    assert hash(loaded) == hash(paper)
    assert loaded != paper.with_values({"formation.rho": 0.1})
    assert paper != "paper-1"


def test_model_copy_updates_derived_attributes(paper: Scenario) -> None:
    _ = paper.hazard, paper.positions
    other = load_scenario("ring")
    assert paper.model_copy() == paper
    assert paper.model_copy().hazard == paper.hazard
    changed = paper.model_copy(update={"hazard_table": other.hazard_table})
    assert changed.hazard == other.hazard
    assert "unknown" in message(paper.model_copy, update={"swram": 1})


# --- with_values, replace


def test_with_values_and_replace_change_only_given_keys(paper: Scenario) -> None:
    changed = paper.with_values({"formation.rho": 0.1, "swarm.a_max": 1})
    assert (changed.formation.rho, changed.swarm.a_max) == (0.1, 1.0)
    assert changed.with_values({"formation.rho": 0.05, "swarm.a_max": 0.5}) == paper
    assert paper.formation.rho == 0.05
    assert changed == paper.replace(swarm={"a_max": 1}, formation={"rho": 0.1})


def test_with_values_accepts_numpy_and_whole_tables(paper: Scenario) -> None:
    positions = np.array([[0.0, 1.0], [1.0, 1.0]])
    target = {"center": [3.0, 3.0], "radius": 1.0}
    changed = paper.with_values(
        {"swarm.positions": positions, "target": target, "target.radius": np.float32(0.25)}
    )
    assert changed.n == 2
    assert changed.target.radius == 0.25
    assert target["radius"] == 1.0


# --- errors


def test_error_of_file_has_its_values(tmp_path: Path, paper: Scenario) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(paper.to_toml().replace("dt = 0.33", "dt = -1"))
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    error = caught.value
    assert (error.file, error.key, error.value) == (path, "time.dt", -1)
    assert error.allowed.startswith("a number above 0")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


@pytest.mark.parametrize("changes", [{"time.dt": -1, "swarm.v_max": 0}, {"guide.margin": 0.5}])
def test_error_has_its_keys(paper: Scenario, changes: dict[str, object]) -> None:
    with pytest.raises(ScenarioError) as caught:
        paper.with_values(changes)
    assert {problem.key for problem in caught.value.problems} == set(changes)
    assert len(changes) > 1 or caught.value.key in changes


# --- functions that take a scenario


FUNCTIONS: dict[str, Callable[[Any], object]] = {
    "plan": csw.plan,
    "plan_swarm": csw.plan_swarm,
    "simulate": csw.simulate,
    "runs_needed": csw.runs_needed,
    "evaluate": csw.evaluate,
    "estimate": csw.estimate,
    "sweep": lambda value: csw.sweep(value, {"n": [1]}),
    "success_bound": csw.success_bound,
    "make_policy": lambda value: csw.make_policy("leader", value),
    "ValueFunction.from_scenario": csw.ValueFunction.from_scenario,
}

WRONG = [
    *((name, "paper-1", "load it first, csw.load_scenario('paper-1')") for name in FUNCTIONS),
    ("plan", Path("mine.toml"), "load it first, csw.load_scenario('mine.toml')"),
    (
        "plan",
        {"name": "a"},
        "load one with csw.load_scenario, or make one with csw.Scenario.from_data",
    ),
]


@pytest.mark.parametrize(("name", "value", "advice"), WRONG)
def test_other_object_instead_of_a_scenario_is_refused_with_advice(
    name: str, value: object, advice: str
) -> None:
    with pytest.raises(TypeError) as caught:
        FUNCTIONS[name](value)
    given = f"the {type(value).__name__} {value!r}"
    assert str(caught.value) == f"{name}() needs a Scenario, not {given}: {advice}"


def test_dir_of_scenario_has_its_keys_and_no_names_of_pydantic():
    names = dir(csw.load_scenario("paper-1"))
    assert {"hazard", "swarm", "n", "with_values", "to_toml", "plot"} <= set(names)
    assert not {"copy", "json", "schema", "parse_obj", "model_dump", "validate"} & set(names)


# --- refined


@pytest.mark.parametrize(
    ("k", "t_f", "steps"), [(1, 10.0, 30), (2, 10.0, 60), (np.int64(4), 0.0825 * 120.5, 120)]
)
def test_refined_has_finer_steps_of_the_same_members(
    paper: Scenario, k: int, t_f: float, steps: int
) -> None:
    scenario = paper.with_values({"guide.a_max": 0.3})
    fine = scenario.refined(k)
    assert (fine.n_steps, fine.time.dt) == (steps, 0.33 / k)
    assert fine.time.t_f == pytest.approx(t_f)
    for a_max in (attrgetter("swarm.a_max"), attrgetter("guide.a_max")):  # sqrt(a_max) / dt
        assert a_max(fine) / fine.time.dt**2 == pytest.approx(a_max(scenario) / 0.33**2)
    same = {"time": vars(scenario.time), "swarm.a_max": 0.5, "guide.a_max": 0.3}
    assert fine.with_values(same) == scenario


def test_rest_to_full_speed_takes_the_same_time_when_refined() -> None:
    scenario = csw.load_scenario("paper-1")

    def seconds(scenario: Scenario) -> float:
        return scenario.swarm.v_max / scenario.swarm.a_max**0.5 * scenario.time.dt

    assert seconds(scenario.refined(5)) == pytest.approx(seconds(scenario))


@pytest.mark.parametrize("k", [0, -1, 1.5, True])
def test_refined_refuses_what_is_no_whole_number(paper: Scenario, k: Any) -> None:
    with pytest.raises(ValueError, match=re.escape(f"k = {k!r}; allowed: whole numbers from 1")):
        paper.refined(k)

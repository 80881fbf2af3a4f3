"""Scenarios as objects and as arguments."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from collections.abc import Callable
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
    rates = scenario.hazard.rates(scenario.positions, np.ones(scenario.n, bool))
    assert rates.shape == (scenario.n,)
    assert (rates < 1).all()


def test_builtin_scenarios_lists_descriptions() -> None:
    listed = builtin_scenarios()
    assert list(listed) == BUILTIN
    assert listed == {name: load_scenario(name).description for name in BUILTIN}


def test_builtin_scenarios_cover_every_feature() -> None:
    assert load_scenario("single-agent").n == 1
    assert load_scenario("large-swarm").n == 50
    assert load_scenario("crossfire").hazard_table.strengths is not None
    assert load_scenario("gauntlet").hazard_table.kind == "saturation+collision"


@pytest.mark.parametrize(
    ("t_f", "dt", "steps"),
    [(10, 0.33, 30), (1.0, 0.1, 10), (0.3, 0.1, 3), (0.99, 0.1, 9), (7, 1, 7), (0.33, 0.33, 1)],
)
def test_steps_are_counted_without_rounding_errors(t_f: float, dt: float, steps: int) -> None:
    assert Time(t_f=t_f, dt=dt).steps == steps


def test_guide_start_is_member_nearest_to_centroid(paper: Scenario) -> None:
    moved = paper.with_values({"swarm.positions": [[0.5, 0], [0, 0.5], [0, 0], [-0.5, 0]]})
    assert moved.guide_start.tolist() == [0, 0]


def test_guide_start_with_ties_is_first_member(paper: Scenario) -> None:
    # 0.1 + 0.2 is not 0.3: rounding alone would prefer one of the two
    pair = paper.with_values({"swarm.positions": [[0.1, 0.3], [0.1, 0.1]]})
    assert pair.guide_start.tolist() == [0.1, 0.3]
    assert paper.with_values({"swarm.positions": [[1, 1], [1, 1]]}).guide_start.tolist() == [1, 1]


def test_guide_a_max_defaults_to_that_of_members(paper: Scenario) -> None:
    assert paper.guide_a_max == 0.1
    assert paper.with_values({"guide.a_max": None}).guide_a_max == 0.5
    assert paper.with_values({"guide.acceleration_limited": False}).guide_a_max == math.inf


def test_arrival_margin_is_corridor_or_half_target_radius(paper: Scenario) -> None:
    free = paper
    assert free.arrival_margin == math.sqrt(0.05)
    assert free.with_values({"formation.rho": 1.0}).arrival_margin == 0.25
    assert free.with_values({"target.radius": 0.2}).arrival_margin == 0.1


def test_arrival_margin_of_single_member_is_negligible(paper: Scenario) -> None:
    assert load_scenario("single-agent").arrival_margin == pytest.approx(5e-7)
    alone = paper.with_values({"guide.margin": None, "swarm.positions": [[0, 0]]})
    assert alone.arrival_margin == pytest.approx(1e-6 * paper.target.radius)


def test_arrival_margin_in_file_is_used(paper: Scenario) -> None:
    assert paper.guide.margin is None
    assert paper.with_values({"guide.margin": 0.05}).arrival_margin == 0.05


def test_arrival_defaults_to_any_step(paper: Scenario) -> None:
    assert paper.guide.arrival == load_scenario("paper-2").guide.arrival == "horizon"
    assert paper.with_values({"guide.arrival": None}).guide.arrival == "any"
    assert load_scenario("wall").guide.arrival == "any"


def test_arrays_are_read_only(paper: Scenario) -> None:
    for array in (paper.positions, paper.guide_start):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_scenario_is_frozen(paper: Scenario) -> None:
    with pytest.raises(ScenarioError, match=r"scenario.with_values\(\{'name': ...\}\)"):
        paper.name = "other"  # type: ignore[misc]
    with pytest.raises(ScenarioError, match=r"with_values\(\{'formation.rho': ...\}\)"):
        paper.formation.rho = 1.0  # type: ignore[misc]
    with pytest.raises(ScenarioError, match=r"hazard\.alpha_1 cannot be set; a changed copy is"):
        paper.hazard_table.alpha_1 = 1.0  # type: ignore[misc]


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


# --- with_values


def test_with_values_changes_only_given_keys(paper: Scenario) -> None:
    changed = paper.with_values({"formation.rho": 0.1, "swarm.a_max": 1})
    assert (changed.formation.rho, changed.swarm.a_max) == (0.1, 1.0)
    assert changed.with_values({"formation.rho": 0.05, "swarm.a_max": 0.5}) == paper
    assert paper.formation.rho == 0.05


def test_with_values_accepts_numpy_and_whole_tables(paper: Scenario) -> None:
    positions = np.array([[0.0, 1.0], [1.0, 1.0]])
    target = {"center": [3.0, 3.0], "radius": 1.0}
    changed = paper.with_values(
        {"swarm.positions": positions, "target": target, "target.radius": np.float32(0.25)}
    )
    assert changed.n == 2
    assert changed.target.radius == 0.25
    assert target["radius"] == 1.0


def test_with_values_of_unknown_key_suggests_closest(paper: Scenario) -> None:
    text = message(paper.with_values, {"formation.ro": 0.1, "swarm.vmax": 1.0})
    assert "unknown key 'formation.ro'; did you mean 'formation.rho'?" in text
    assert "unknown key 'swarm.vmax'; did you mean 'swarm.v_max'?" in text
    assert "'paper-1'" in text


def test_with_values_of_wrong_type_names_key(paper: Scenario) -> None:
    text = message(paper.with_values, {"formation.rho": "wide"})
    assert "formation.rho is 'wide'; it must be a number above 0" in text
    text = message(paper.with_values, {"swarm": 3, "swarm.v_max": 1.0})
    assert "swarm.v_max cannot be set: swarm is 3, not a table of keys" in text


# --- replace


def test_replace_changes_only_given_keys(paper: Scenario) -> None:
    changed = paper.replace(guide={"arrival": "any"}, formation={"rho": 0.1})
    assert (changed.guide.arrival, changed.formation.rho) == ("any", 0.1)
    assert changed == paper.with_values({"guide.arrival": "any", "formation.rho": 0.1})


def test_replace_of_unknown_key_suggests_closest(paper: Scenario) -> None:
    assert "did you mean 'formation.rho'?" in message(paper.replace, formation={"ro": 0.1})


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


def test_error_of_several_keys_lists_problems(paper: Scenario) -> None:
    with pytest.raises(ScenarioError) as caught:
        paper.with_values({"time.dt": -1, "swarm.v_max": 0})
    assert {problem.key for problem in caught.value.problems} == {"time.dt", "swarm.v_max"}


def test_error_of_contradicting_keys_has_key(paper: Scenario) -> None:
    with pytest.raises(ScenarioError) as caught:
        paper.with_values({"guide.margin": 0.5})
    assert caught.value.key == "guide.margin"


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


@pytest.mark.parametrize("name", FUNCTIONS)
def test_name_instead_of_a_scenario_is_refused_with_advice(name: str) -> None:
    with pytest.raises(TypeError) as caught:
        FUNCTIONS[name]("paper-1")
    assert str(caught.value) == (
        f"{name}() needs a Scenario, not the str 'paper-1': "
        "load it first, csw.load_scenario('paper-1')"
    )


def test_path_instead_of_a_scenario_is_refused_with_advice() -> None:
    with pytest.raises(TypeError, match=r"load it first, csw.load_scenario\('mine.toml'\)"):
        csw.plan(Path("mine.toml"))  # type: ignore[arg-type]


def test_other_object_instead_of_a_scenario_is_refused_with_advice() -> None:
    with pytest.raises(TypeError, match=r"not the dict \{'name': 'a'\}: load one with"):
        csw.plan({"name": "a"})  # type: ignore[arg-type]

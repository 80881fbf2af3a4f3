"""casswarm scenarios and scenario files of a user."""

import json
import re
import tomllib

import pytest
from commands import casswarm, with_hazard

from casswarm import Scenario, load_scenario, save_scenario
from casswarm.scenario.validation import known_keys


def test_list_prints_names_and_descriptions(tmp_path):
    text = casswarm(tmp_path, "scenarios", "list").stdout
    assert "paper-1" in text
    assert "calibration" in text
    assert len(text.splitlines()) >= 6


def test_show_prints_a_valid_file(tmp_path):
    text = casswarm(tmp_path, "scenarios", "show", "wall").stdout
    (tmp_path / "shown.toml").write_text(text)
    assert "valid" in casswarm(tmp_path, "scenarios", "check", "shown.toml").stdout


def test_new_writes_a_named_file_with_comments(tmp_path):
    casswarm(tmp_path, "scenarios", "new", "mine.toml", "--from", "ring")
    text = (tmp_path / "mine.toml").read_text()
    assert 'name = "mine"' in text
    assert 'description = "copied from ring"' in text
    assert "# Radius of the target zone, in units of length.\nradius = " in text
    assert "mine.toml" in casswarm(tmp_path, "scenarios", "check", "mine.toml").stdout


def test_new_shows_every_optional_key_commented_out(tmp_path):
    casswarm(tmp_path, "scenarios", "new", "mine.toml", "--from", "paper-2")
    text = (tmp_path / "mine.toml").read_text()
    for key in known_keys(Scenario):
        leaf = key.rpartition(".")[2]
        table = rf"\[{key}(\.\w+)?\]$|\[\[{key}\]\]$"
        assert re.search(rf"^(# )?({table}|{leaf} = )", text, re.MULTILINE), key
    optional = "strengths|core_radius|margin"
    changed, number = re.subn(rf"^# (?=({optional}) = )", "", text, flags=re.MULTILINE)
    assert number == 3
    scenario = Scenario.from_data(tomllib.loads(changed))
    assert scenario.hazard_table.strengths == (1.0, 2.0)
    assert scenario.guide.margin == 0.1


def test_new_leaves_out_no_parameters_that_are_given(own_rates):
    casswarm(own_rates, "scenarios", "new", "two.toml", "--from", "own.toml", "--allow-code")
    text = (own_rates / "two.toml").read_text()
    assert "\n[hazard.parameters]\nstrength = 2.0\n" in text
    assert "# [hazard.parameters]" not in text
    assert "valid" in casswarm(own_rates, "scenarios", "check", "two.toml", "--allow-code").stdout


def test_new_overwrites_a_file_with_force(tmp_path):
    (tmp_path / "mine.toml").write_text("mine")
    casswarm(tmp_path, "scenarios", "new", "mine.toml", "--force")
    assert "[swarm]" in (tmp_path / "mine.toml").read_text()


def test_check_with_a_wrong_file_reports_all_and_fails(tmp_path):
    (tmp_path / "wrong.toml").write_text("name = 3\n")
    done = casswarm(tmp_path, "scenarios", "check", "wrong.toml", "paper-1", code=2)
    assert "wrong.toml" in done.stderr
    assert "paper-1" in done.stdout


def test_new_with_too_long_name_exits_with_1(tmp_path):
    assert "too long" in casswarm(tmp_path, "scenarios", "new", "x" * 400, code=1).stderr


@pytest.fixture
def own_rates(tmp_path):
    """Folder with a scenario file whose rates are in a module beside it."""
    (tmp_path / "mine.py").write_text(
        "def rate(positions, alive, strength):\n"
        "    return strength / (1 + (positions[:, 0] - 4) ** 2 + (positions[:, 1] - 4) ** 2)\n"
    )
    lines = 'kind = "mine:rate"\n[hazard.parameters]\nstrength = 2.0'
    text = load_scenario("single-agent").to_toml()
    (tmp_path / "own.toml").write_text(with_hazard(text, lines))
    return tmp_path


@pytest.mark.slow
def test_plan_with_own_rates_names_the_missing_bound(own_rates):
    text = casswarm(own_rates, "plan", "own.toml", "--allow-code").stdout
    assert "not certified: the bound needs a lower bound of your rates" in text


def test_plan_of_which_no_solve_succeeds_writes_its_tables_and_fails(own_rates):
    (own_rates / "mine.py").write_text(
        "import casadi as ca\n\n\ndef rate(positions, alive, strength):\n"
        "    return strength + ca.sqrt(ca.fmax(-1 - positions[:, 0] ** 2, 0))\n"
    )
    done = casswarm(own_rates, "plan", "own.toml", "--allow-code", "--no-figures", code=1)
    assert done.stderr.count("warning: not a minimum: no solve succeeded (ipopt: ") == 1
    assert "Error: no solve succeeded: the tables and run.json in " in done.stderr
    assert "with respect to positions[0] is nan" in " ".join(done.stdout.split())
    assert (own_rates / "results" / "plan-single-agent" / "guide.csv").exists()


@pytest.mark.parametrize(("setting", "members"), [("n=3", 3), ("spacing=0.2", 5)])
def test_set_takes_derived_parameters(tmp_path, setting, members):
    options = ("--set", setting, "--no-certify", "--no-figures")
    assert f"paper-1: {members} members" in casswarm(tmp_path, "plan", "paper-1", *options).stdout


def test_set_of_unknown_key_names_derived_parameters(tmp_path):
    done = casswarm(tmp_path, "evaluate", "paper-1", "--set", "nn=2", code=2)
    assert "unknown key 'nn'" in done.stderr
    assert done.stderr.endswith("; beyond its keys there are n and spacing\n")


@pytest.mark.slow
def test_simulate_with_own_rates_on_two_workers_succeeds(own_rates):
    done = casswarm(own_rates, "simulate", "own.toml", "--allow-code", "--runs", 20, "--workers", 2)
    assert "leader" in done.stdout


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("hazard.radars=[[6, 3.1], [6, 3.1]]", "the same point: their rates are added"),
        ("hazard.radars=[[8, 6]]", "lies in the target zone"),
        ("swarm.positions=[[0, 0], [0, 0]]", "collide from the start"),
    ],
)
def test_questionable_scenario_is_warned_of(tmp_path, setting, words):
    values = dict(text.split("=") for text in ("target.center=[8, 6]", setting))
    scenario = load_scenario("paper-2").with_values(
        {key: json.loads(value) for key, value in values.items()}
    )
    save_scenario(scenario, tmp_path / "mine.toml")
    assert words in casswarm(tmp_path, "scenarios", "check", "mine.toml").stderr


def test_questionable_setting_is_warned_of(tmp_path):
    setting = "hazard.radars=[[2, 1.5], [2, 1.5]]"
    done = casswarm(tmp_path, "plan", "single-agent", "--set", setting, "--no-certify")
    assert "the same point: their rates are added" in done.stderr

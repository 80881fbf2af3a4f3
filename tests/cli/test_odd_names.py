"""Names with characters that a terminal, a figure or a file system would not take as text."""

import json

import pytest
from commands import casswarm

import casswarm as csw

ESC, BIDI = "\x1b[2J", "\u202e"


def is_plain(text):
    return all(c.isprintable() or c in "\n\r\t" for c in text)


@pytest.mark.parametrize("name", [ESC, BIDI, "\x07", "$x$"])
def test_file_with_odd_name_is_used_and_its_name_escaped(tmp_path, name):
    path = f"a{name}b.toml"
    text = casswarm(tmp_path, "scenarios", "show", "single-agent").stdout
    (tmp_path / path).write_text(text.replace("v_max = ", "v_max = -"))
    done = casswarm(tmp_path, "scenarios", "check", path, code=2)
    assert is_plain(done.stderr)
    assert "swarm.v_max" in done.stderr


@pytest.mark.parametrize(
    "name", ["a\\u001b[2J", "a\\u202eb", "a\\u0000", "a$x_{$", "a/b", "..", ""]
)
def test_scenario_with_odd_name_is_refused(tmp_path, name):
    text = casswarm(tmp_path, "scenarios", "show", "single-agent").stdout
    (tmp_path / "odd.toml").write_text(text.replace('name = "single-agent"', f'name = "{name}"'))
    done = casswarm(tmp_path, "plan", "odd.toml", code=2)
    assert "name is" in done.stderr
    assert "printable characters" in done.stderr
    assert is_plain(done.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["odd.toml"]


def test_policy_with_odd_name_is_refused(tmp_path):
    code = "import casswarm as csw\n\nodd = csw.as_policy(lambda *_: 0, name='a$x_{$')\n"
    (tmp_path / "mine.py").write_text(code)
    options = ("--policy", "mine:odd", "--runs", 2)
    done = casswarm(tmp_path, "simulate", "single-agent", *options, code=2)
    assert "'a$x_{$': figures and files need printable characters" in done.stderr


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
    scenario = csw.load_scenario("paper-2").with_values(
        {key: json.loads(value) for key, value in values.items()}
    )
    csw.save_scenario(scenario, tmp_path / "mine.toml")
    assert words in casswarm(tmp_path, "scenarios", "check", "mine.toml").stderr


def test_questionable_setting_is_warned_of(tmp_path):
    setting = "hazard.radars=[[2, 1.5], [2, 1.5]]"
    done = casswarm(tmp_path, "plan", "single-agent", "--set", setting, "--no-certify")
    assert "the same point: their rates are added" in done.stderr

"""Scenario files: found, read and written; syntax errors, and files that are none."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from builtin_names import BUILTIN
from commands import casswarm
from scenario_messages import message

from casswarm import ScenarioError, load_scenario
from casswarm.scenario import Scenario, save_scenario
from casswarm.scenario.scenario_files import MAX_BYTES, MAX_KEY_PARTS
from casswarm.scenario.validation import fields, subtable


def test_load_unknown_name_suggests_closest_and_lists_all() -> None:
    text = message(load_scenario, "paper1")
    assert "no scenario 'paper1': it is neither a built-in scenario nor a file" in text
    assert "did you mean 'paper-1'?" in text
    assert all(name in text for name in BUILTIN)


@pytest.mark.parametrize("source", ["", "zzzzzz", "a\0b", "no/such/file.toml"])
def test_load_unrelated_name_lists_all(source: str) -> None:
    text = message(load_scenario, source)
    assert "did you mean" not in text
    assert "crossfire" in text


def test_load_path_object_ignores_builtin_names() -> None:
    assert "no scenario 'paper-1'" in message(load_scenario, Path("paper-1"))


def test_load_folder_is_refused(tmp_path: Path) -> None:
    assert f"{tmp_path} is a folder; name a TOML file in it" in message(load_scenario, tmp_path)


def test_load_unreadable_file_reports_reason(
    file: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    path = file()
    monkeypatch.setattr(Path, "read_bytes", refuse)
    assert f"{path} cannot be read: Permission denied" in message(load_scenario, path)


def test_load_binary_file_reports_encoding(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"name = \xff\xfe\x00")
    text = message(load_scenario, path)
    assert f"{path} is not text in UTF-8 (byte 7); save it as" in text


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing yet\n"])
def test_load_empty_file_suggests_template(tmp_path: Path, text: str) -> None:
    path = tmp_path / "empty.toml"
    path.write_text(text)
    assert f"{path} is empty; start from a built-in one" in message(load_scenario, path)


def test_load_syntax_error_reports_line_and_column(file: Callable[..., Path]) -> None:
    path = file(("v_max = 2.0", "v_max = 2.0.0"))
    text = message(load_scenario, path)
    line = 1 + path.read_text()[: path.read_text().index("v_max")].count("\n")
    assert f"scenario file {path} is not valid TOML:" in text
    assert f"(at line {line}, column 12)" in text


@pytest.mark.parametrize("value", ["1" * 5000, "[" * 100_000])
def test_load_file_with_huge_value_is_refused(file: Callable[..., Path], value: str) -> None:
    path = file(("v_max = 2.0", f"v_max = {value}"))
    assert f"scenario file {path} cannot be read" in message(load_scenario, path)


def test_load_accepts_byte_order_mark_and_crlf(file: Callable[..., Path], paper: Scenario) -> None:
    path = file()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load_scenario(path) == paper


def test_unknown_key_suggests_closest(file: Callable[..., Path]) -> None:
    text = message(load_scenario, file(("v_max =", "vmax =")))
    assert "unknown key 'swarm.vmax'; did you mean 'swarm.v_max'?" in text


def test_key_in_wrong_table_suggests_right_table(file: Callable[..., Path]) -> None:
    text = message(load_scenario, file(("[time]\ndt", "dt"), ("t_f", "[time]\nt_f")))
    assert "unknown key 'target.dt'; did you mean 'time.dt'?" in text
    assert "time.dt is missing; it must be a number above 0" in text


def test_unrelated_key_lists_keys_of_table(file: Callable[..., Path]) -> None:
    text = message(load_scenario, file(("rho", "zzz = 1\nrho")))
    assert (
        "unknown key 'formation.zzz'; the keys of [formation] are rho, learning_rate, iterations"
        in text
    )


def test_unknown_table_suggests_closest(file: Callable[..., Path]) -> None:
    text = message(load_scenario, file(("[swarm]", "[swarms]")))
    assert "unknown key 'swarms'; did you mean 'swarm'?" in text
    assert "swarm is missing; it must be a table with the keys positions, velocity" in text


def test_several_problems_are_listed_one_per_line(file: Callable[..., Path]) -> None:
    path = file(("v_max = 2.0", 'v_max = "2"'), ("dt = 0.33", "dt = -1"), ("alpha_1 = 4.0\n", ""))
    assert message(load_scenario, path).splitlines() == [
        f"scenario file {path} is invalid:",
        "  swarm.v_max is '2'; it must be a number above 0 (from 1e-20 to 1e+20)",
        "  time.dt is -1; it must be a number above 0 (from 1e-20 to 1e+20)",
        "  hazard.alpha_1 is missing; kind 'saturation' needs it: a number above 0 "
        "(from 1e-20 to 1e+20)",
    ]


def test_scenario_of_deeply_nested_data_is_refused() -> None:
    value: list[object] = []
    for _ in range(5000):
        value = [value]
    text = message(Scenario.from_data, {"name": "deep", "swarm": value})
    assert "nesting of tables or arrays in it is too deep" in text


def test_load_of_too_long_name_is_refused() -> None:
    assert "x" * 400 in message(load_scenario, "x" * 400)


# --- files written


def test_saved_file_has_one_point_per_line(paper: Scenario) -> None:
    text = paper.to_toml()
    assert "    [0.0, 0.0],\n    [0.45, 0.45],\n" in text
    assert "center = [13.4, 5.9]" in text
    assert "beta_1" not in text
    assert "parameters" not in text


def test_save_to_missing_folder_reports_reason(paper: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "no" / "such" / "folder.toml"
    text = message(save_scenario, paper, path)
    assert text == f"cannot write the scenario file {path}: No such file or directory"


@pytest.mark.parametrize("name", BUILTIN)
def test_saved_comments_describe_every_key(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    save_scenario(scenario, tmp_path / "commented.toml", comments=True)
    assert load_scenario(tmp_path / "commented.toml") == scenario
    text = (tmp_path / "commented.toml").read_text(encoding="utf-8")
    lines = text.splitlines()
    comments = " ".join(line.removeprefix("# ") for line in lines if line.startswith("# "))
    models = [Scenario, *filter(None, map(subtable, fields(Scenario).values()))]
    known = [item for model in models for item in fields(model).items()]
    for key in (line.split(" = ")[0] for line in lines if " = " in line and line[0] != "#"):
        assert any(name == key and str(field.description) in comments for name, field in known), key


# --- files that are refused before they are read or parsed


POSIX = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs fifos and devices")


@POSIX
def test_fifo_without_writer_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    done = casswarm(tmp_path, "scenarios", "check", "pipe.toml", code=2)
    assert "pipe.toml cannot be read: it is a fifo, a socket or a device" in done.stderr


@POSIX
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null"])
def test_device_is_refused(tmp_path, device):
    done = casswarm(tmp_path, "plan", device, code=2)
    assert f"{device} cannot be read: it is a fifo, a socket or a device" in done.stderr


def test_large_file_is_refused(tmp_path):
    file = tmp_path / "large.toml"
    file.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(ScenarioError, match=r"it has 1,000,001 bytes, more than .* 1,000,000"):
        load_scenario(file)


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 300) + " = 1",
        "[" + " . ".join(['"a"'] * 300) + "]",
        "x = { " + ".".join(["'a'"] * 300) + " = 1 }",
    ],
)
def test_key_of_hundreds_of_parts_is_refused(tmp_path, text):
    file = tmp_path / "deep.toml"
    file.write_text(text)
    words = re.escape(f"a key in it has more than {MAX_KEY_PARTS} dotted parts")
    with pytest.raises(ScenarioError, match=words):
        load_scenario(file)


@pytest.mark.parametrize("text", ["a" * 900_000, "a." * 9 + "a" * 900_000, "'" * 900_000])
def test_search_for_long_keys_takes_linear_time(tmp_path, text):
    file = tmp_path / "word.toml"
    file.write_text(text)
    started = time.monotonic()
    with pytest.raises(ScenarioError):
        load_scenario(file)
    assert time.monotonic() - started < 30


# --- syntax errors: the quoted line, the caret and the hint


HINTS = {
    "name = ring": 'a text needs quotes: "ring"',
    "name = “ring”": "a text needs straight quotes",
    'name = "ring\na = 1': "a quote is missing",
    "a = True": "write true, in lower case and without quotes",
    "a = yes": "write true, in lower case and without quotes",
    "a = [no]": "write false, in lower case and without quotes",
    "a = None": "omit the key instead",
    "dt = 0,33": "a number has a decimal point: 0.33",
    "dt = .33": "a number needs a digit before its point: 0.33",
    "dt = 5.": "a number needs a digit after its point: 5.0",
    "dt = 05": "a number has no zeros in front",
    "dt = 1/3": "a number stands alone: no units, no calculations",
    "dt = 3 m": "a number stands alone: no units, no calculations",
    "dt: 0.33": "write KEY = VALUE, or [TABLE] in brackets",
    "dt =": "the key has no value",
    "a = [(0, 0)]": "a list is written in square brackets",
    "a = [0.5 0.5]": "a comma is missing between two values",
    "a = [\n  [0, 0]\n  [1, 1]\n]": "a comma is missing between two values",
    "a = [[3, 4], [5, 6]\n[time]\ndt = 1": "the list a, which begins in line 1, lacks a ']'",
    "b = 1\na = [[3, 4],": "the list a, which begins in line 2, lacks a ']'",
    "a = [1, 2]]": "there is a ']' too many",
    "a = [1,,2]": "there is a comma too many",
    "[time\ndt = 1": "a ']' must end the name of the table",
    "a = 1\na = 2": "a key or table may occur only once",
    'a = "C:\\users"': r"a backslash in a text is written \\, or use single quotes",
    "// slow": "one KEY = VALUE a line; comments start with '#'",
}


@pytest.mark.parametrize("text", HINTS)
def test_syntax_error_has_a_hint(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    found = message(load_scenario, path)
    assert found.startswith(f"scenario file {path} is not valid TOML:\n  ")
    assert f"  hint: {HINTS[text]}" in found.splitlines()[-1]


def test_syntax_error_quotes_the_line_with_a_caret(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\r\n[time]\r\n\tdt = 0,33\r\n', newline="")
    assert message(load_scenario, path).splitlines()[1:] == [
        "  Expected newline or end of document after a statement (at line 3, column 8)",
        "     dt = 0,33",
        "           ^",
        "  hint: a number has a decimal point: 0.33",
    ]


def test_syntax_error_in_a_long_line_is_short_and_soon_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"a = [{'1' * 4000}, {'1, ' * 20_000} x y]\n")
    started = time.perf_counter()
    lines = message(load_scenario, path).splitlines()
    assert time.perf_counter() - started < 20.0
    assert max(map(len, lines)) < 200
    assert lines[-2].index("^") == lines[-3].index("x")

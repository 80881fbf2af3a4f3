"""Scenario files: found, read and written; syntax errors, and files that are none."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from builtin_names import BUILTIN
from commands import casswarm
from scenario_messages import edited, message

from casswarm import ScenarioError, load_scenario
from casswarm.scenario import Scenario, save_scenario
from casswarm.scenario.scenario_files import MAX_BYTES, MAX_KEY_PARTS
from casswarm.scenario.validation import element_table, fields, subtable

HERE = Path(__file__).parent
UNRELATED = ("", "zzzzzz", "a\0b", "no/such/file.toml")
SOURCES: list[tuple[str | Path, str]] = [
    ("paper1", "no scenario 'paper1': it is neither a built-in scenario nor a file"),
    ("paper1", "did you mean 'paper-1'?"),
    *(("paper1", name) for name in BUILTIN),
    *((name, "crossfire") for name in UNRELATED),
    (Path("paper-1"), "no scenario 'paper-1'"),  # a path is no name
    (HERE, f"{HERE} is a folder; name a TOML file in it"),
    ("x" * 400, "x" * 400),
]


@pytest.mark.parametrize(("source", "words"), SOURCES)
def test_load_of_what_is_no_scenario_is_refused(source: str | Path, words: str) -> None:
    text = message(load_scenario, source)
    assert words in text
    assert source not in UNRELATED or "did you mean" not in text


DEEP = f"a key in it has more than {MAX_KEY_PARTS} dotted parts"
REFUSED: dict[str, tuple[bytes, *tuple[str, ...]]] = {
    "binary": (b"name = \xff\xfe\x00", "{path} is not text in UTF-8 (byte 7); save it as"),
    "empty": (b"", "{path} is empty; start from a built-in one"),
    "blank lines": (b"\n\n", "{path} is empty; start from a built-in one"),
    "a comment": (b"# nothing yet\n", "{path} is empty; start from a built-in one"),
    "long": (b"#" * (MAX_BYTES + 1), "it has 1,000,001 bytes, more than", " 1,000,000"),
    "huge number": (edited(("= 2.0", f"= {'1' * 5000}")), "scenario file {path} cannot be read"),
    "deep list": (edited(("= 2.0", f"= {'[' * 100_000}")), "scenario file {path} cannot be read"),
    "deep key": (b".".join([b"a"] * 300) + b" = 1", DEEP),
    "deep table": (b"[" + b" . ".join([b'"a"'] * 300) + b"]", DEEP),
    "deep key of a value": (b"x = { " + b".".join([b"'a'"] * 300) + b" = 1 }", DEEP),
    "unknown key": (
        edited(("v_max =", "vmax =")),
        "unknown key 'swarm.vmax'; did you mean 'swarm.v_max'?",
    ),
    "key of another table": (
        edited(("[time]\ndt", "dt"), ("t_f", "[time]\nt_f")),
        "unknown key 'target.dt'; did you mean 'time.dt'?",
        "time.dt is missing; it must be a number above 0",
    ),
    "unrelated key": (
        edited(("rho", "zzz = 1\nrho")),
        "unknown key 'formation.zzz'; the keys of [formation] are rho, learning_rate, iterations, "
        "leader_selection, follower_weight",
    ),
    "unknown table": (
        edited(("[swarm]", "[swarms]")),
        "unknown key 'swarms'; did you mean 'swarm'?",
        "swarm is missing; it must be a table with the keys positions, velocity",
    ),
    "misplaced parameter": (
        edited(('kind = "saturation"', 'kind = "mine:rates"\nwidth = 3')),
        "[hazard.parameters]",
    ),
    "several problems": (
        edited(("v_max = 2.0", 'v_max = "2"'), ("dt = 0.33", "dt = -1"), ("alpha_1 = 4.0\n", "")),
        "scenario file {path} is invalid:\n"
        "  swarm.v_max is '2'; it must be a number above 0 (from 1e-20 to 1e+20)\n"
        "  time.dt is -1; it must be a number above 0 (from 1e-20 to 1e+20)\n"
        "  hazard.alpha_1 is missing; kind 'saturation' needs it: a number above 0 "
        "(from 1e-20 to 1e+20){end}",
    ),
    "syntax": (
        edited(("v_max = 2.0", "v_max = 2.0.0")),
        "scenario file {path} is not valid TOML:",
        "(at line 13, column 12)",
    ),
    "caret": (
        b'name = "mine"\r\n[time]\r\n\tdt = 0,33\r\n',
        "\n  Expected newline or end of document after a statement (at line 3, column 8)\n"
        "     dt = 0,33\n"
        "           ^\n"
        "  hint: a number has a decimal point: 0.33{end}",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_file_is_refused_in_these_words(tmp_path: Path, case: str) -> None:
    path, (content, *words) = tmp_path / "mine.toml", REFUSED[case]
    path.write_bytes(content)
    text = message(load_scenario, path) + "{end}"
    assert [part for part in words if part.replace("{path}", str(path)) not in text] == []


def test_load_unreadable_file_reports_reason(
    file: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    path = file()
    monkeypatch.setattr(Path, "read_bytes", refuse)
    assert f"{path} cannot be read: Permission denied" in message(load_scenario, path)


def test_load_accepts_byte_order_mark_and_crlf(file: Callable[..., Path], paper: Scenario) -> None:
    path = file()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load_scenario(path) == paper


def test_scenario_of_deeply_nested_data_is_refused() -> None:
    value: list[object] = []
    for _ in range(5000):
        value = [value]
    text = message(Scenario.from_data, {"name": "deep", "swarm": value})
    assert "nesting of tables or arrays in it is too deep" in text


@pytest.mark.parametrize("data", [{"x" * 100_000: 1}, {"name": "x" * 100_000}])
def test_scenario_of_long_texts_is_refused_in_short(data: dict[str, object]) -> None:
    text = message(Scenario.from_data, data)
    assert "xxx..." in text
    assert max(map(len, text.splitlines())) < 400


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
    inner = [field for model in models for field in fields(model).values()]
    models += filter(None, map(element_table, inner))
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


def test_syntax_error_in_a_long_line_is_short_and_soon_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"a = [{'1' * 4000}, {'1, ' * 20_000} x y]\n")
    started = time.perf_counter()
    lines = message(load_scenario, path).splitlines()
    assert time.perf_counter() - started < 20.0
    assert max(map(len, lines)) < 200
    assert lines[-2].index("^") == lines[-3].index("x")

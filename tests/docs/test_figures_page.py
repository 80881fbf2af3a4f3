"""The pages on figures are correct: pictures exist and are small, commands and code work."""

import re
import runpy
import shlex
from pathlib import Path

import click
import pytest
from commands import python

from casswarm.cli import main

ROOT = Path(__file__).resolve().parents[2]
PAGE = "".join(
    (ROOT / "docs" / name).read_text(encoding="utf-8")
    for name in ("figures.md", "figure-catalogue.md")
)
LINKED = re.findall(r"!\[[^]]+\]\((images/[^)]+)\)", PAGE)


def test_pictures_exist_are_small_and_have_alt_text():
    assert len(LINKED) > 15
    assert len(LINKED) == PAGE.count("![")
    for name in LINKED:
        assert (ROOT / "docs" / name).stat().st_size < 500_000, name


def test_pictures_are_drawn_by_the_script():
    script = runpy.run_path(str(ROOT / "docs" / "draw_figures.py"), run_name="read")
    drawn = {
        f"images/{source}-{figure}.png"
        for source, figures in script["FIGURES"].items()
        for figure in figures
    }
    drawn |= {"images/simulate-paper-1.gif", "images/simulate-paper-2.gif"}
    assert set(LINKED) <= drawn
    assert {path.name for path in (ROOT / "docs" / "images").iterdir()} >= {
        name.removeprefix("images/") for name in drawn
    }


def commands():
    shown = re.findall(r"`(casswarm [^`]+)`", PAGE) + re.findall(r"^(casswarm .+)$", PAGE, re.M)
    return sorted({" ".join(command.split()) for command in shown})


@pytest.mark.parametrize("command", commands())
def test_command_on_page_parses(command):
    words = shlex.split(command)[1:]
    known = main.commands[words[0]]
    try:
        known.make_context(words[0], words[1:])
    except click.MissingParameter:
        assert words[1:] == []  # a command mentioned by name


@pytest.mark.slow
def test_code_on_page_runs(tmp_path):
    pytest.importorskip("IPython", reason="requires the extra `notebooks`")
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.M | re.S)
    assert len(blocks) == 3
    (tmp_path / "code.py").write_text("\n".join(blocks))
    python("code.py", folder=tmp_path)
    assert (tmp_path / "formation.pdf").read_bytes().startswith(b"%PDF")

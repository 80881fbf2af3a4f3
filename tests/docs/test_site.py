"""The site builds without warnings, and its generated references are complete."""

from __future__ import annotations

from html import unescape
from pathlib import Path
from types import ModuleType

import click
import pytest
from commands import python

import casswarm
from casswarm.cli import main
from casswarm.scenario import Scenario
from casswarm.scenario.validation import allowed, fields, subtable

pytest.importorskip("sphinx", reason="requires the extra `docs`")
pytest.importorskip("furo", reason="requires the extra `docs`")

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Site built without executing notebooks, which `test_notebooks` does."""
    folder = tmp_path_factory.mktemp("site")
    options = ("-q", "-W", "--keep-going", "-b", "html", "-D", "nb_execution_mode=off")
    places = ("-d", folder / "trees", "docs", folder / "html")
    python("-W", "default", "-m", "sphinx", *options, *places, folder=ROOT)
    return folder / "html"


def page(site: Path, name: str) -> str:
    return unescape((site / f"{name}.html").read_text(encoding="utf-8"))


def test_api_reference_has_every_public_name(site: Path) -> None:
    pages = (site / "api").rglob("*.html")
    text = "".join(unescape(path.read_text(encoding="utf-8")) for path in pages)
    public = {name: getattr(casswarm, name) for name in casswarm.__all__}
    modules = [value for value in public.values() if isinstance(value, ModuleType)]
    anchors = [f"casswarm.{name}" for name, value in public.items() if value not in modules]
    anchors += [f"module-{module.__name__}" for module in modules]
    anchors += [
        f"{module.__name__}.{name}"
        for module in modules
        for name in module.__all__
        if callable(getattr(module, name)) and name not in public
    ]
    assert not [anchor for anchor in anchors if f'id="{anchor}"' not in text]


def test_scenario_reference_has_every_key_with_its_limits(site: Path) -> None:
    text = page(site, "scenario-files")
    for name, field in fields(Scenario).items():
        table = subtable(field)
        assert table is None or f"[{name}]" in text
        for key, inner in fields(table).items() if table else ():
            assert f">{key}</span>" in text, key
            assert allowed(inner).split(" (")[0].split("'")[0] in text, key


def test_command_reference_has_every_option(site: Path) -> None:
    text = page(site, "commands")
    for name, command in main.commands.items():
        assert f"casswarm {name}" in text
        for option in command.params:
            if isinstance(option, click.Option):
                assert f">{option.opts[0]}</span>" in text, f"{name} {option.opts[0]}"


def test_site_has_every_page_and_notebook(site: Path) -> None:
    generated = {"_build", "notebooks"}
    for source in (ROOT / "docs").rglob("*.md"):
        name = source.relative_to(ROOT / "docs").with_suffix("")
        assert generated & set(name.parts) or (site / f"{name}.html").exists()
    for script in (ROOT / "notebooks").glob("*.py"):
        assert (site / "notebooks" / f"{script.stem}.html").exists()

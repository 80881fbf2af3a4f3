"""Rooms import one way only; importing casswarm is cheap; public names resolve; files are short."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import casswarm

ROOT = Path(__file__).parents[1]
FOLDERS = ("casswarm", "problems", "cli")
HEAVY = {"casadi", "pandas", "matplotlib", "scipy", "numba", "pydantic", "jinja2", "gymnasium"}
HEAVY |= {"PIL", "numpy"}
MAX_LINES = 600


def test_imports_between_rooms_keep_the_contracts(tmp_path: Path) -> None:
    # import-linter walks one folder: in a checkout, problems/ and cli/ stand beside casswarm/
    ignored = shutil.ignore_patterns("__pycache__")
    for folder in FOLDERS:
        target = tmp_path / ("casswarm" if folder == "casswarm" else f"casswarm/{folder}")
        shutil.copytree(ROOT / folder, target, ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    code = "from importlinter.cli import lint_imports_command as lint; lint()"
    linted = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert linted.returncode == 0, linted.stdout + linted.stderr
    assert " 0 broken" in linted.stdout


def packages_loaded_by(code: str) -> set[str]:
    """Top-level packages that a fresh interpreter has imported after `code`."""
    report = f"{code}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    command = [sys.executable, "-c", report]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


def test_import_casswarm_loads_nothing_heavy() -> None:
    loaded = packages_loaded_by("import casswarm; dir(casswarm); casswarm.__version__")
    assert "casswarm" in loaded
    assert not loaded & HEAVY


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["plan", "--help"]])
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "from casswarm.cli import main\n"
        f"try:\n    main({arguments!r}, prog_name='casswarm')\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
    )
    assert not packages_loaded_by(code) & HEAVY


def test_plan_loads_neither_tables_nor_figures() -> None:
    code = "import casswarm; casswarm.plan(casswarm.load_scenario('paper-1'))"
    assert not packages_loaded_by(code) & {"pandas", "matplotlib"}


@pytest.mark.parametrize("name", casswarm.__all__)
def test_public_name_resolves(name: str) -> None:
    value = getattr(casswarm, name)
    assert name in dir(casswarm)
    if isinstance(value, ModuleType):
        assert value.__name__.endswith(f".{name}")
        assert dir(value) == sorted(value.__all__)
    else:
        assert value.__name__ == name
        assert value.__module__.startswith("casswarm.")


def test_unknown_name_raises_attribute_error() -> None:
    with pytest.raises(AttributeError, match="simulatte"):
        casswarm.simulatte  # noqa: B018


def test_files_are_short() -> None:
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    lengths = {str(p): len(p.read_text(encoding="utf-8").splitlines()) for p in files}
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def test_no_name_of_a_package_is_that_of_a_file_in_it() -> None:
    # the import of the file would put the module in the place of the name (lazy_loader < 0.6)
    stubs = [path for folder in FOLDERS for path in (ROOT / folder).rglob("__init__.pyi")]
    assert len(stubs) > 10
    for stub in stubs:
        imports = [
            node
            for node in ast.parse(stub.read_text(encoding="utf-8")).body
            if isinstance(node, ast.ImportFrom)
        ]
        names = {
            alias.asname or alias.name for node in imports if node.module for alias in node.names
        }
        assert not names & {path.stem for path in stub.parent.iterdir()}, stub

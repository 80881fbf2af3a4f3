"""Measured tables: each has a command, is on one page, and is too old when its code has changed."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
CODE = '''\
"""A module."""


def double(x):
    """Twice x."""
    return 2 * x
'''


@pytest.fixture
def measurements(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The program."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import measurements

    return measurements


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("2 * x", "x + x", False),
        ("Twice", "Two times", True),
        ("\n\n\n", "\n\n# a comment\n\n", True),
    ],
    ids=["code", "docstring", "comment"],
)
def test_fingerprint_is_that_of_code_alone(
    measurements: ModuleType, tmp_path: Path, old: str, new: str, same: bool
) -> None:
    prints = []
    for version, text in enumerate((CODE, CODE.replace(old, new))):
        room = tmp_path / str(version) / "room"
        room.mkdir(parents=True)
        (room / "module.py").write_text(text)
        prints.append(measurements.fingerprint(["room"], room.parent))
    assert (prints[0] == prints[1]) == same


def test_file_that_is_new_or_missing_changes_the_fingerprint(
    measurements: ModuleType, tmp_path: Path
) -> None:
    (tmp_path / "a.py").write_text(CODE)
    (tmp_path / "b.py").write_text(CODE)
    one = measurements.fingerprint(["a.py"], tmp_path)
    assert one != measurements.fingerprint(["a.py", "b.py"], tmp_path)
    with pytest.raises(FileNotFoundError, match="no gone"):
        measurements.fingerprint(["gone"], tmp_path)


def test_every_table_is_on_one_page(measurements: ModuleType) -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md"))
    included = Counter(re.findall(r"measured/([\w-]+)\.inc", pages))
    assert included == Counter(table.name for table in measurements.tables())
    for table in measurements.tables():
        text = table.path.read_text(encoding="utf-8")
        assert f"`{table.command}`" in text
        assert text.count("\n|") >= 3
        (script,) = re.findall(r"benchmarks/\w+\.py", table.command)
        assert (ROOT / script).exists()


def test_old_table_is_named_with_its_remedy_and_made_again(tmp_path: Path) -> None:
    for name in ("measurements.py", "structure.py"):
        (tmp_path / "benchmarks").mkdir(exist_ok=True)
        (tmp_path / "benchmarks" / name).write_text((ROOT / "benchmarks" / name).read_text())
    folder = tmp_path / "docs" / "measured"
    folder.mkdir(parents=True)
    (tmp_path / "module.py").write_text(CODE)
    (folder / "tables.toml").write_text(
        '[doubles]\ncommand = "python -c \'print(1 + 1)\'"\ncode = ["module.py"]\n'
    )

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        program = tmp_path / "benchmarks" / "measurements.py"
        command = [sys.executable, str(program), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    done = run("--check")
    assert done.returncode == 1
    assert "doubles.inc is older than module.py: python benchmarks/measurements.py" in done.stderr
    assert run("doubles").returncode == 0
    assert (folder / "doubles.inc").read_text().endswith(":\n\n2\n")
    assert run("--check").returncode == 0
    (tmp_path / "module.py").write_text(CODE.replace("2", "3"))
    assert run("--check").returncode == 1
    assert "too old" in run().stdout
    assert run("halves").returncode == 2

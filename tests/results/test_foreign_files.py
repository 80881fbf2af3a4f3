"""Results folders: only files that casswarm wrote, and nobody changed, are replaced or removed."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from casswarm.results import ResultsFolder


def written(path: Path, names: tuple[str, ...], content: str, command: str = "plan") -> None:
    """Results of a command, with files of these names."""
    folder = ResultsFolder.create(command, None, path)
    for name in names:
        folder.write_file(name, content)
    folder.write_record({}, {})


def names(path: Path) -> set[str]:
    return {file.name for file in path.iterdir()}


def test_files_of_an_earlier_run_are_replaced_and_removed(tmp_path: Path) -> None:
    written(tmp_path, ("a.csv", "b.csv"), "1")
    written(tmp_path, ("a.csv",), "2")
    assert names(tmp_path) == {"a.csv", "run.json"}
    assert (tmp_path / "a.csv").read_text() == "2"


def test_what_a_killed_process_left_of_a_file_is_removed(tmp_path: Path) -> None:
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    others = f".part-{os.getppid()}-a.csv", f".part-{killed.pid}-notes.txt", ".part-x-a.csv"
    for name in (f".part-{killed.pid}-a.csv", *others):
        (tmp_path / name).touch()
    written(tmp_path, ("a.csv",), "1")
    assert names(tmp_path) == {"a.csv", "run.json", *others}


def test_files_of_another_command_are_kept(tmp_path: Path) -> None:
    written(tmp_path, ("a.csv", "b.csv"), "1", "simulate")
    written(tmp_path, ("a.csv",), "2")
    assert names(tmp_path) == {"a.csv", "b.csv", "run.json"}


def test_file_that_was_changed_is_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    written(tmp_path, ("a.csv", "b.csv"), "1")
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("my notes")
    with caplog.at_level(logging.WARNING):
        written(tmp_path, ("a.csv",), "2")
    assert names(tmp_path) == {"a.csv", "a.csv.bak", "b.csv", "run.json"}
    assert (tmp_path / "a.csv.bak").read_text() == "my notes"
    assert (tmp_path / "b.csv").read_text() == "my notes"
    assert "a.csv is not of casswarm: kept as a.csv.bak" in caplog.text


@pytest.mark.parametrize("name", ["a.csv", "run.json"])
@pytest.mark.parametrize("link", [False, True])
def test_foreign_file_is_set_aside(tmp_path: Path, name: str, link: bool) -> None:
    folder, victim = tmp_path / "results", tmp_path / "victim"
    folder.mkdir()
    victim.write_text('{"of": "another program"}')
    for aside in ("", ".bak"):
        if link:
            (folder / (name + aside)).symlink_to(victim)
        else:
            (folder / (name + aside)).write_text(victim.read_text())
    written(folder, ("a.csv",), "1")
    assert names(folder) == {"a.csv", "run.json", f"{name}.bak", f"{name}.2.bak"}
    for aside in (victim, folder / f"{name}.bak", folder / f"{name}.2.bak"):
        assert aside.read_text() == '{"of": "another program"}'
    assert not (folder / name).is_symlink()


def test_record_of_somebody_else_removes_nothing_outside(tmp_path: Path) -> None:
    written(tmp_path / "results", ("a.csv",), "1")
    record = json.loads((tmp_path / "results" / "run.json").read_text())
    (tmp_path / "victim").write_text("1")
    (tmp_path / "results" / "linked").symlink_to(tmp_path / "victim")
    listed = {"../victim": record["files"]["a.csv"], str(tmp_path / "victim"): "", "linked": ""}
    record["files"] |= listed | {"linked": record["files"]["a.csv"]}
    (tmp_path / "results" / "run.json").write_text(json.dumps(record))
    written(tmp_path / "results", ("b.csv",), "1")
    assert (tmp_path / "victim").read_text() == "1"
    assert names(tmp_path / "results") == {"b.csv", "linked", "run.json"}

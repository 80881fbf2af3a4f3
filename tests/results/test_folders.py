"""Results folders: they are read back as they were written; what is damaged, endless or too large
is one line; only files that casswarm wrote, and nobody changed, are replaced or removed.
"""

from __future__ import annotations

import io
import json
import logging
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import SMALL_SIMULATION, casswarm

from casswarm import CheckpointError, evaluate, load_scenario, plan, simulate
from casswarm._util import files
from casswarm.results import ResultsFolder
from casswarm.results.folder import pack
from casswarm.studies.tables import distribution_table

FIFO = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs fifos")


def archive_of_terabytes():
    """An archive whose array declares a petabyte."""
    header, archive = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
    )
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("json.npy", header.getvalue())
    return archive.getvalue()


def archive_without_objects():
    archive = io.BytesIO()
    np.savez(archive, json=np.array('{"items": {}}'))
    return archive.getvalue()


DAMAGED = [
    ("run.json", None, "has no run.json"),
    ("run.json", b"{", "cannot be read"),
    ("run.json", b"[1]", "of an unknown origin"),
    ("run.json", b'{"command": "fly"}', "casswarm fly"),
    ("results.npz", None, "has no results.npz: it was removed"),
    ("results.npz", b"PK", r"results\.npz cannot be read"),
    ("results.npz", archive_of_terabytes(), r"results\.npz cannot be read"),
    ("results.npz", archive_without_objects(), "saves no trajectories"),
    *(
        ("summary.csv", content, r"summary\.csv cannot be read")
        for content in (b"", b"\n", b"\xff\xfe\x00")
    ),
    ("summary.csv", b'# a text,\nof "two lines', "lack 'policy': one of them is damaged"),
    ("summary.csv", b"policy,success\n", "damaged"),
]


@pytest.fixture
def folder(finished, tmp_path):
    """Results of a simulation that a test may change."""
    return shutil.copytree(finished(*SMALL_SIMULATION, "--no-figures")[0], tmp_path / "copy")


def drawn(folder):
    """Draw all figures of a folder."""
    for draw in ResultsFolder.open(folder).figures().values():
        draw()


def test_results_folder_returns_objects_equal_to_the_bit(tmp_path):
    scenario = load_scenario("paper-1")
    guide = plan(scenario)
    study = simulate(scenario, ["leader", "constrained"], runs=4, guide=guide, save_trajectories=3)
    distribution = evaluate(scenario, "leader", 0.1, guide=guide)
    written = ResultsFolder.create("simulate", scenario, tmp_path / "here")
    written.write_objects(
        guide=guide, trajectories=study.trajectories, distributions=[distribution]
    )
    written.write_record({}, {})
    folder = ResultsFolder.open(tmp_path / "here")
    assert folder.scenario == scenario
    for name in ("positions", "velocities", "rates"):
        np.testing.assert_array_equal(getattr(folder.guide, name), getattr(guide, name))
    assert folder.guide.solution.as_row() == guide.solution.as_row()
    assert str(folder.guide) == str(guide)
    assert folder.guide.certificate == guide.certificate
    assert list(folder.trajectories) == ["leader", "constrained"]
    for policy, saved in study.trajectories.items():
        for one, other in zip(folder.trajectories[policy], saved, strict=True):
            for name in ("positions", "alive", "leaders"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    (again,) = folder.objects["distributions"]
    assert again.success == distribution.success
    pd.testing.assert_frame_equal(distribution_table([again]), distribution_table([distribution]))
    np.testing.assert_array_equal(again.population, distribution.population)
    with pytest.raises(CheckpointError, match=r"no trajectories of 'leder'.*did you mean 'leader'"):
        folder.trajectory("leder")


def test_pack_refuses_objects_of_other_classes():
    with pytest.raises(TypeError, match="not JSON serializable"):
        pack({"scenario": load_scenario("paper-1")})


# --- damaged


@pytest.mark.parametrize(("name", "content", "words"), DAMAGED)
def test_plot_of_damaged_folder_is_refused(folder, name, content, words):
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_bytes(content)
    with pytest.raises(CheckpointError, match=words):
        drawn(folder)


def test_plot_of_table_without_column_is_one_line(folder):
    table = folder / "summary.csv"
    table.write_text(table.read_text().replace("success_low", "low"))
    done = casswarm(folder.parent, "plot", folder, "--quiet", code=2)
    assert done.stderr.count("\n") == 1
    assert "lack 'success_low': one of them is damaged" in done.stderr


def test_words_for_numbers_are_error(folder):
    table = folder / "summary.csv"
    header, row = table.read_text().splitlines()
    table.write_text(f"{header}\n{','.join(['word'] * len(row.split(',')))}\n")
    with pytest.raises(CheckpointError, match=r"a table or results\.npz is damaged; run casswarm"):
        drawn(folder)


@FIFO
@pytest.mark.parametrize("name", ["run.json", "summary.csv", "results.npz"])
def test_fifo_in_folder_is_refused(folder, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    done = casswarm(folder.parent, "plot", folder, code=2)
    assert f"{name} cannot be read" in done.stderr
    assert "it is a fifo, a socket or a device" in done.stderr


def test_objects_that_decompress_to_too_much_are_refused(folder, monkeypatch):
    monkeypatch.setattr(files, "MAX_ARRAYS", 100_000)
    with zipfile.ZipFile(folder / "results.npz", "a", zipfile.ZIP_DEFLATED) as file:
        file.writestr("array999.npy", bytes(10_000_000))
    assert (folder / "results.npz").stat().st_size < 100_000
    with pytest.raises(CheckpointError, match="bytes when decompressed, more than 100,000"):
        drawn(folder)


@pytest.mark.parametrize("name", ["MAX_JSON", "MAX_TABLE", "MAX_ARRAYS"])
def test_large_files_are_refused(folder, monkeypatch, name):
    monkeypatch.setattr(files, name, 10)
    with pytest.raises(CheckpointError, match="bytes, more than the limit of 10"):
        drawn(folder)


@pytest.mark.parametrize("scenario", [3, "[", "a" * 10])
def test_damaged_scenario_of_record_is_error(folder, scenario):
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(record | {"scenario": scenario}))
    with pytest.raises(CheckpointError, match=r"the scenario in .* is damaged") as caught:
        drawn(folder)
    assert caught.value.folder == folder


def test_nested_record_is_error(folder):
    (folder / "run.json").write_text("[" * 100_000)
    with pytest.raises(CheckpointError, match="cannot be read") as caught:
        drawn(folder)
    assert caught.value.folder == folder


# --- files of others


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

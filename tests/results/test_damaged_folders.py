"""Results folders of others: what is damaged, endless or too large is one line."""

from __future__ import annotations

import io
import json
import os
import shutil
import zipfile

import numpy as np
import pytest
from commands import casswarm

from casswarm import CheckpointError
from casswarm._util import files
from casswarm.results import ResultsFolder

FIFO = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs fifos")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated")
    options = ("--runs", 5, "--policy", "naive", "--quiet")
    casswarm(folder, "simulate", "single-agent", *options)
    return folder / "results" / "simulate-single-agent"


@pytest.fixture
def folder(simulated, tmp_path):
    return shutil.copytree(simulated, tmp_path / "copy")


def drawn(folder):
    """Draw all figures of a folder."""
    for draw in ResultsFolder.open(folder).figures().values():
        draw()


def test_plot_of_table_without_column_is_one_line(folder):
    table = folder / "summary.csv"
    table.write_text(table.read_text().replace("success_low", "low"))
    done = casswarm(folder.parent, "plot", folder, "--quiet", code=2)
    assert done.stderr.count("\n") == 1
    assert "lack 'success_low': one of them is damaged" in done.stderr


@pytest.mark.parametrize(
    "content", [b"", b"\n", b"\xff\xfe\x00", b'# a text,\nof "two lines', b"policy,success\n"]
)
def test_plot_of_table_that_is_none_is_error(folder, content):
    (folder / "summary.csv").write_bytes(content)
    with pytest.raises(CheckpointError):
        drawn(folder)


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


def test_array_of_declared_terabytes_is_refused(folder):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
    )
    with zipfile.ZipFile(folder / "results.npz", "w") as file:
        file.writestr("json.npy", header.getvalue())
    with pytest.raises(CheckpointError, match=r"results\.npz cannot be read"):
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

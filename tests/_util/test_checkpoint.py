"""The store: whole cells or none, one process at a time, inputs that fit."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from casswarm._util.checkpoint import Checkpoint, IfExists, file_name
from casswarm.errors import CheckpointError

INPUTS = {"scenario": {"name": "a", "rho": 0.05}, "runs": 10}
CELL = {"x": np.array([0.1, -0.0, np.nan]), "name": np.array("µ")}


def test_checkpoint_returns_saved_arrays_bit_for_bit(tmp_path: Path) -> None:
    with Checkpoint(tmp_path, INPUTS) as store:
        store.save("one", CELL)
    with Checkpoint(tmp_path, INPUTS, if_exists="resume") as store:
        assert store.names() == ["one"]
        back = store.load("one")
        assert back is not None
        assert back["x"].tobytes() == CELL["x"].tobytes()
        assert str(back["name"]) == "µ"
        assert store.load("two") is None


@pytest.mark.parametrize("spoil", ["cut", "flip", "empty"])
def test_checkpoint_load_of_damaged_record_is_none(tmp_path: Path, spoil: str) -> None:
    with Checkpoint(tmp_path, INPUTS) as store:
        store.save("one", CELL)
        path = tmp_path / "checkpoint" / "one.npz"
        data = bytearray(path.read_bytes())
        data[100] ^= 1
        path.write_bytes({"cut": data[:-7], "flip": data, "empty": b""}[spoil])
        assert store.load("one") is None


def test_checkpoint_with_other_inputs_names_differences(tmp_path: Path) -> None:
    with Checkpoint(tmp_path, INPUTS) as store:
        store.save("one", CELL)
    other = {"scenario": {"name": "a", "rho": 0.1}, "runs": 10, "seed": 1}
    with pytest.raises(CheckpointError) as error, Checkpoint(tmp_path, other, if_exists="resume"):
        pass
    assert "scenario.rho: 0.05 there, 0.1 now" in str(error.value)
    assert "seed: nothing there, 1 now" in str(error.value)
    assert "runs" not in str(error.value).split("inputs:")[1]
    with Checkpoint(tmp_path, INPUTS, if_exists="resume") as store:
        assert store.names() == ["one"]  # nothing was touched


def test_checkpoint_with_unfinished_study_raises(tmp_path: Path) -> None:
    with Checkpoint(tmp_path, INPUTS) as store:
        store.save("one", CELL)
    with (
        pytest.raises(CheckpointError, match=r"unfinished.*--resume.*--overwrite"),
        Checkpoint(tmp_path, INPUTS),
    ):
        pass
    with Checkpoint(tmp_path, INPUTS, if_exists="overwrite") as store:
        assert store.names() == []
        store.save("one", CELL)
        store.finish()
    with Checkpoint(tmp_path, {"runs": 3}) as store:  # a finished study may be replaced
        assert store.names() == []


@pytest.mark.parametrize("choice", ["error", "resume", "overwrite"])
def test_checkpoint_of_which_nothing_was_saved_is_started_again(
    tmp_path: Path, choice: IfExists
) -> None:
    with pytest.raises(KeyError), Checkpoint(tmp_path, INPUTS):
        raise KeyError  # of a policy that does not work yet, say
    corrected = INPUTS | {"code": {"policy": "corrected"}}
    with Checkpoint(tmp_path, corrected, choice) as store:
        store.save("one", CELL)
    with Checkpoint(tmp_path, corrected, "resume") as store:
        assert store.names() == ["one"]


HOLD = """
import sys, time
from casswarm._util.checkpoint import Checkpoint
with Checkpoint(sys.argv[1], {}, if_exists="overwrite"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_checkpoint_lock_excludes_second_process_until_death(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(CheckpointError, match=f"in use by process {holder.pid} on "),
            Checkpoint(tmp_path, {}, if_exists="resume"),
        ):
            pass
    finally:
        holder.kill()
        holder.communicate()
    with Checkpoint(tmp_path, {}, if_exists="resume"):
        pass


def test_checkpoint_lock_is_released_after_error(tmp_path: Path) -> None:
    with pytest.raises(KeyError), Checkpoint(tmp_path, INPUTS):
        raise KeyError
    with Checkpoint(tmp_path, INPUTS, if_exists="resume"):
        pass


def test_file_names_are_unique_and_valid() -> None:
    names = [file_name(text) for text in ("leader", "a/b", "a:b", "a b", "ä", "x" * 300 + "/")]
    assert names[0] == "leader"
    assert len(set(names)) == len(names)
    assert all(name.isascii() and "/" not in name and len(name) < 100 for name in names)


# --- what is not of the study


def test_checkpoint_keeps_records_with_lost_inputs(tmp_path: Path) -> None:
    with Checkpoint(tmp_path, {"runs": 1}) as store:
        store.save("one", {"x": np.zeros(1)})
    (tmp_path / "checkpoint" / "inputs.json").write_text("{")
    for choice in ("error", "resume"):
        with (
            pytest.raises(CheckpointError, match="--overwrite"),
            Checkpoint(tmp_path, {"runs": 1}, choice),
        ):
            pass
    with Checkpoint(tmp_path, {"runs": 1}, if_exists="overwrite") as store:
        assert store.names() == []


@pytest.mark.parametrize("arrays", [b"", b"no archive", b"PK\x05\x06" + bytes(18)])
def test_checkpoint_load_of_forged_record_is_none(tmp_path: Path, arrays: bytes) -> None:
    with Checkpoint(tmp_path, INPUTS) as store:
        store.save_json("one", {"a": 1})
        path = tmp_path / "checkpoint" / "one.npz"
        header = path.read_bytes()[: len(b"casswarm record\n") + 32]
        path.write_bytes(header + hashlib.sha256(b"one\n" + arrays).digest() + arrays)
        assert not store.load("one")
        assert store.load_json("one") is None


def test_checkpoint_ignores_record_of_other_inputs_or_of_another_name(tmp_path: Path) -> None:
    for seed in (1, 2):
        with Checkpoint(tmp_path / str(seed), {"seed": seed}) as store:
            store.save("one", {"x": np.array(seed)})
    records = [tmp_path / str(seed) / "checkpoint" for seed in (1, 2)]
    (records[1] / "one.npz").write_bytes((records[0] / "one.npz").read_bytes())
    (records[0] / "two.npz").write_bytes((records[0] / "one.npz").read_bytes())
    with Checkpoint(tmp_path / "2", {"seed": 2}, if_exists="resume") as store:
        assert store.load("one") is None
    with Checkpoint(tmp_path / "1", {"seed": 1}, if_exists="resume") as store:
        assert store.load("one") is not None
        assert store.load("two") is None


@pytest.mark.parametrize("choice", ["error", "resume", "overwrite"])
def test_checkpoint_keeps_foreign_files(tmp_path: Path, choice: IfExists) -> None:
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "checkpoint" / "thesis.tex").write_text("years of work")
    with (
        pytest.raises(CheckpointError, match=r"thesis\.tex"),
        Checkpoint(tmp_path, INPUTS, choice),
    ):
        pass
    assert (tmp_path / "checkpoint" / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("name", ["thesis.npz", "notes.txt", "finished", "folder"])
@pytest.mark.parametrize("link", [False, True])
def test_checkpoint_deletes_no_foreign_file(tmp_path: Path, name: str, link: bool) -> None:
    with Checkpoint(tmp_path, INPUTS) as store:
        store.save("one", CELL)
    path, elsewhere = tmp_path / "checkpoint" / name, tmp_path / "elsewhere"
    target = elsewhere if link else path
    if name == "folder":
        target.mkdir()
    else:
        target.write_text("years of work")
    if link:
        path.symlink_to(elsewhere)
    with (
        pytest.raises(CheckpointError, match=f"files of other origin, such as {name}"),
        Checkpoint(tmp_path, INPUTS, if_exists="overwrite"),
    ):
        pass
    assert path.exists()
    assert (tmp_path / "checkpoint" / "one.npz").exists()
    assert name == "folder" or target.read_text() == "years of work"


@pytest.mark.parametrize("name", ["lock", "lock-holder", "inputs.json", "finished", "one.npz"])
def test_checkpoint_writes_through_no_link(tmp_path: Path, name: str) -> None:
    (tmp_path / "checkpoint").mkdir()
    victim = tmp_path / "victim"
    victim.write_text("years of work")
    (tmp_path / "checkpoint" / name).symlink_to(victim)
    replaced = nullcontext(), pytest.raises(CheckpointError, match=name)
    with replaced[name != "lock-holder"], Checkpoint(tmp_path, INPUTS, "resume") as store:
        store.save("one", CELL)
        store.finish()
    assert victim.read_text() == "years of work"


def test_checkpoint_folder_that_is_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "checkpoint").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(CheckpointError, match="not of casswarm"), Checkpoint(tmp_path, INPUTS):
        pass
    assert not list((tmp_path / "elsewhere").iterdir())

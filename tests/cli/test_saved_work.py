"""Messages say that finished work is saved only where some is."""

from __future__ import annotations

import time

import numpy as np
import pytest

from casswarm._util.checkpoint import Checkpoint
from casswarm.cli.common import Failure, reported_errors
from casswarm.errors import FolderError


def message(folder, error, since=0.0):
    """Message of a command whose study in a folder fails with an error."""

    def fail():
        with reported_errors() as saved:
            saved.folder, saved.since = folder, since
            raise error

    with pytest.raises(Failure) as caught:
        fail()
    return caught.value.message


def save_record(folder):
    with Checkpoint(folder, {"seed": 1}) as store:
        store.save("batch", {"x": np.zeros(2)})


def full_disk(folder):
    error = FolderError(f"cannot write {folder}")
    error.__cause__ = OSError("no space left on device")
    return error


def test_failure_before_anything_is_saved_does_not_mention_saved_work(tmp_path):
    with Checkpoint(tmp_path, {"seed": 1}):
        pass
    assert message(tmp_path, KeyboardInterrupt()) == "interrupted"
    assert message(None, KeyboardInterrupt()) == "interrupted"
    assert message(tmp_path, full_disk(tmp_path)) == f"cannot write {tmp_path}"
    assert message(tmp_path, OSError(28, "no space")) == "[Errno 28] no space"


def test_failure_after_a_record_says_how_to_continue(tmp_path):
    save_record(tmp_path)
    assert message(tmp_path, KeyboardInterrupt()) == (
        f"interrupted; finished work is saved in {tmp_path}: continue with --resume"
    )
    assert message(tmp_path, full_disk(tmp_path)).endswith(
        f"; finished work is saved in {tmp_path}: free some space, then continue with --resume"
    )


def test_records_of_an_earlier_study_are_not_this_ones_work(tmp_path):
    save_record(tmp_path)
    assert message(tmp_path, KeyboardInterrupt(), time.time() + 60) == "interrupted"

"""Suppressed standard output is restored, wherever Ctrl-C occurs."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import FrameType

import pytest

from casswarm._util import silence as module
from casswarm._util.silence import silence


def test_output_of_process_and_python_is_discarded(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with silence():
        print("python")
        os.write(1, b"process\n")
    print("after")
    assert capfd.readouterr().out == "before\nafter\n"


@pytest.mark.parametrize("python", [sys.stdout, None])
def test_program_without_standard_output_keeps_none(
    python: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdout", python)
    with silence():
        assert sys.stdout is not python
    assert sys.stdout is python


def interrupt_at(event: int) -> bool:
    """Raise KeyboardInterrupt at the given event in the module; return False if there are fewer.

    Events are those where CPython handles signals: a function begins, or a call has returned.
    """
    left = event

    def profile(frame: FrameType, kind: str, _argument: object) -> None:
        nonlocal left
        if frame.f_code.co_filename == module.__file__ and kind in {"call", "c_return"}:
            left -= 1
            if left < 0:
                raise KeyboardInterrupt

    sys.setprofile(profile)
    try:
        with silence():
            pass
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(None)
    return False


def test_ctrl_c_never_leaves_standard_output_redirected() -> None:
    python, process = sys.stdout, os.fstat(1)
    descriptors = len(list(Path("/proc/self/fd").iterdir())) if sys.platform == "linux" else 0
    events = 0
    while interrupt_at(events):
        assert sys.stdout is python, events
        assert os.path.samestat(os.fstat(1), process), events
        events += 1
    assert events > 15
    if descriptors:  # one may be lost where it is opened or closed
        assert len(list(Path("/proc/self/fd").iterdir())) <= descriptors + events // 4

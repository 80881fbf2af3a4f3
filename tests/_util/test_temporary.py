"""Temporary files of killed processes are removed by the next; all others are kept."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from commands import python

from casswarm._util import files as temporary

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="does nothing on Windows")

MAKE = """
import os, signal, sys
from casswarm._util.files import temporary_file, temporary_folder
(temporary_folder() / "file").write_text("content")
temporary_file(".log")
print(*sorted(os.listdir(sys.argv[1])), flush=True)
os.kill(os.getpid(), getattr(signal, sys.argv[2])) if len(sys.argv) > 2 else None
"""


def make(folder: Path, *ending: str) -> list[str]:
    """Files that a process sees, which makes two and then ends."""
    code = -signal.SIGKILL if ending else 0
    return python("-c", MAKE, folder, *ending, code=code, TMPDIR=str(folder)).stdout.split()


def test_files_are_removed_at_end_of_process(tmp_path: Path) -> None:
    assert len(make(tmp_path)) == 2
    assert not list(tmp_path.iterdir())


def test_files_of_killed_process_are_removed_by_next(tmp_path: Path) -> None:
    killed = make(tmp_path, "SIGKILL")
    assert len(killed) == len(list(tmp_path.iterdir())) == 2
    assert not set(make(tmp_path)) & set(killed)
    assert not list(tmp_path.iterdir())


def test_files_of_others_and_links_are_kept(tmp_path: Path) -> None:
    host, dead = temporary._HOST, dead_process()
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "file").touch()
    (tmp_path / f"casswarm-{host}-{dead}-link").symlink_to(mine)
    (tmp_path / f"casswarm-{host}-{os.getpid()}-alive.log").touch()
    (tmp_path / f"casswarm-other{host}-{dead}-x.log").touch()
    (tmp_path / f"casswarm-{dead}.log").touch()
    before = sorted(tmp_path.rglob("*"))
    make(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.skipif(sys.platform != "win32" and os.geteuid() != 0, reason="only root can give away")
def test_files_of_other_user_are_kept(tmp_path: Path) -> None:
    path = tmp_path / f"casswarm-{temporary._HOST}-{dead_process()}-x.log"
    path.touch()
    os.chown(path, 12345, -1)
    make(tmp_path)
    assert path.exists()


def test_compiled_code_of_killed_process_is_removed_where_code_is_generated(tmp_path: Path) -> None:
    abandoned = tmp_path / f"casswarm-{temporary._HOST}-{dead_process()}-x"
    abandoned.mkdir()
    code = "from casswarm.compiled import generated_module\ngenerated_module('number = 3')\n"
    python("-c", code, TMPDIR=str(tmp_path), CASSWARM_CACHE=str(tmp_path / "cache"))
    assert not abandoned.exists()


def dead_process() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid

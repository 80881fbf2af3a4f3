"""Damaged files of compiled code are compiled again; folders that others can write are not used."""

import os
import shutil
import sys

import pytest
from compiled_module import run_compiled

from casswarm.compiled import private_folder

HEALTHY = "1 1"
posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other permissions")
slow = pytest.mark.slow


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


DAMAGES = {
    "flipped": flipped,
    "emptied": lambda content: content[:0],
    "cut": lambda content: content[: len(content) // 2],
    "planted": lambda content: b"cos\nsystem\n(S'exit 3'\ntR." + content,  # runs a command
}
CASES = [(suffix, damage) for suffix in ("nbc", "nbi", "py") for damage in DAMAGES]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A healthy cache, to be copied."""
    folder = tmp_path_factory.mktemp("compiled")
    run_compiled(folder)
    assert run_compiled(folder)[0] == HEALTHY
    return folder


@pytest.fixture
def cache(compiled, tmp_path):
    return shutil.copytree(compiled, tmp_path / "cache")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "damage"), [CASES[0], *(pytest.param(*case, marks=slow) for case in CASES[1:])]
)
def test_damaged_file_is_replaced(cache, suffix, damage):
    damaged = list(cache.rglob(f"*.{suffix}"))
    assert damaged
    for path in damaged:
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    hits, _ = run_compiled(cache)
    # a module that is written again is new to old versions of Numba, which compare times
    assert hits in ((HEALTHY, "0 0") if suffix == "py" else ("0 0",))
    assert run_compiled(cache)[0] == HEALTHY


@slow
def test_damaged_file_in_numba_cache_dir_is_replaced(tmp_path):
    given = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    run_compiled(tmp_path / "casswarm", **given)
    damaged = list((tmp_path / "numba").rglob("*.nb?"))
    assert len(damaged) >= 4  # an index and machine code of the module's two kernels, at least
    for path in damaged:
        path.write_bytes(b"")
    assert run_compiled(tmp_path / "casswarm", **given) == ("0 0", "")
    assert run_compiled(tmp_path / "casswarm", **given)[0] == HEALTHY


def test_bytecode_of_generated_module_is_neither_kept_nor_used(compiled):
    assert list(compiled.rglob("*.nbc"))
    assert not list(compiled.rglob("*.pyc"))


@posix
def test_private_folder_is_made_for_its_user_only(tmp_path):
    previous = os.umask(0)
    try:
        private_folder(tmp_path / "above" / "new")
    finally:
        os.umask(previous)
    assert (tmp_path / "above" / "new").stat().st_mode & 0o777 == 0o700


@posix
def test_folders_of_compiled_code_are_private(tmp_path):
    run_compiled(tmp_path / "new")
    for folder in (tmp_path / "new", tmp_path / "new" / "__pycache__"):
        assert folder.stat().st_mode & 0o777 == 0o700


@posix
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702, 0o1777])
def test_private_folder_that_others_can_write_raises(tmp_path, mode):
    tmp_path.chmod(mode)
    with pytest.raises(PermissionError, match=rf"mode {mode:o}\): chmod go-w"):
        private_folder(tmp_path)
    tmp_path.chmod(0o755)
    assert private_folder(tmp_path) == tmp_path


@posix
@pytest.mark.skipif(sys.platform != "win32" and os.geteuid() != 0, reason="only root can give away")
def test_private_folder_of_other_user_raises(tmp_path):
    os.chown(tmp_path, 12345, -1)
    with pytest.raises(PermissionError, match=r"belongs to another user \(uid 12345\)"):
        private_folder(tmp_path)


@posix
def test_cache_folder_that_others_can_write_is_refused(cache):
    (module,) = cache.glob("*.py")
    cache.chmod(0o777)
    module.write_text("raise SystemExit('not mine')")
    hits, messages = run_compiled(cache)
    assert hits == "0 0"
    assert f"other users may write in {cache} (mode 777): chmod go-w" in messages
    assert "this process only" in messages
    assert "not mine" in module.read_text()


@posix
@pytest.mark.slow
def test_pycache_that_others_can_write_is_not_used(cache):
    (cache / "__pycache__").chmod(0o777)
    assert run_compiled(cache)[0] == "0 0"
    assert run_compiled(cache)[0] == HEALTHY  # in a private folder beside it


@posix
@slow
def test_numba_cache_dir_that_others_can_write_is_refused(tmp_path):
    given = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    run_compiled(tmp_path / "casswarm", **given)
    for folder in (tmp_path / "numba").iterdir():
        folder.chmod(0o777)
    hits, messages = run_compiled(tmp_path / "casswarm", **given)
    assert hits == "0 0"
    assert "NUMBA_CACHE_DIR is not used" in messages

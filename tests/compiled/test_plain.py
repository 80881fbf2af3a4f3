"""Kernels with Numba's public functions only: they take over where its inside has changed."""

import pytest
from commands import python
from compiled_module import run_compiled

WARNING = "kernels compile in twice the time: Numba has changed inside"
PLAIN = {"CASSWARM_PLAIN_NUMBA": "1"}
NAME_IS_GONE = "import numba.core.caching as m; del m._CacheLocator"
CLASS_IS_NONE = "import numba.core.codegen as m; m.JITCodeLibrary = 1"
CLASS_DIFFERS = "import numba.core.codegen as m; m.JITCodeLibrary = int"  # fails when compiling
DISPATCHER_DIFFERS = "import numba.core.registry as m; m.CPUDispatcher = object"
SMALL_STUDY = """
import casswarm as csw
from casswarm.compiled import parallel
from casswarm.policies import formation_policies

parallel._cores, formation_policies._PER_THREAD = (lambda: 3), 10
study = csw.simulate(csw.load_scenario("paper-1"), ["leader"], runs=100, save_trajectories=100)
for each in study.trajectories["leader"]:
    print(*(number.hex() for number in each.positions.ravel().tolist()))
print(study.runs.to_csv())
"""


@pytest.mark.slow
def test_plain_kernel_and_objective_are_compiled_once(tmp_path):
    hits, messages = run_compiled(tmp_path, **PLAIN)
    assert hits == "0 0"
    assert "compiling once" in messages
    assert run_compiled(tmp_path, **PLAIN) == ("1 1", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        NAME_IS_GONE,
        *(
            pytest.param(change, marks=pytest.mark.slow)
            for change in (CLASS_IS_NONE, CLASS_DIFFERS, DISPATCHER_DIFFERS)
        ),
    ],
)
def test_plain_numba_takes_over_where_its_inside_has_changed(tmp_path, change):
    given = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}  # of no earlier version
    hits, messages = run_compiled(tmp_path / "ours", change, **given)
    assert hits == "0 0"
    assert messages.count(WARNING) == 1
    hits, messages = run_compiled(tmp_path / "ours", change, **given)
    assert hits == "1 1"
    assert messages.count(WARNING) == 1


@pytest.mark.slow
def test_plain_numba_without_folder_compiles_for_this_process(tmp_path):
    (tmp_path / "file").write_text("in the way")
    hits, messages = run_compiled(tmp_path / "file", **PLAIN)
    assert hits == "0 0"
    assert "this process only" in messages


@pytest.mark.slow
def test_plain_numba_simulates_the_same_numbers(tmp_path):
    numbers = python("-c", SMALL_STUDY).stdout
    given = {"CASSWARM_CACHE": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    found = python("-c", f"{CLASS_DIFFERS}\n{SMALL_STUDY}", **given)
    assert WARNING in found.stderr
    assert found.stdout == numbers

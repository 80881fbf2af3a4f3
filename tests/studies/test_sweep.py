"""Sweeps: points equal evaluate and simulate, failures are rows, nothing is lost."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import slow_policy
from commands import CASSWARM, python
from slow_policy import toward
from sweep_cases import GRID, SMALL

import casswarm as csw
from casswarm.cli.sweep import _values
from casswarm.errors import CheckpointError
from casswarm.scenario.variations import whole_numbers, with_parameters

PAIR = SMALL.with_values({"swarm.positions": [[0.0, 0.0], [0.5, 0.0]]})


@pytest.mark.slow
def test_sweep_points_equal_evaluate_and_simulate() -> None:
    exact = csw.sweep(SMALL, GRID, [toward, "leader"], tolerance=1e-3).table
    sampled = csw.sweep(SMALL, GRID, [toward], runs=50, seed=3).table
    assert len(exact) == 12
    assert exact[["hazard.alpha_1", "n", "policy"]].drop_duplicates().shape[0] == 12
    for row in exact.to_dict("records"):
        scenario = with_parameters(SMALL, {key: row[key] for key in GRID})
        policy = toward if row["policy"] == "toward" else "leader"
        law = csw.evaluate(scenario, policy, 1e-3)
        assert (row["success_low"], row["success_high"]) == law.success
        assert (row["status"], row["method"], row["states"]) == ("ok", "exact", law.states)
    for row in sampled.to_dict("records"):
        scenario = with_parameters(SMALL, {key: row[key] for key in GRID})
        summary = csw.simulate(scenario, [toward], 50, 3).summary.iloc[0]
        assert row["success_high"] == summary["success_high"]
        assert row["successes"] == summary["successes"]


def test_sweep_point_that_fails_has_reason() -> None:
    found = csw.sweep(SMALL, {"formation.rho": [0.05, -1.0, 0.1]}, ["leader"], tolerance=0.1)
    assert found.table["status"].tolist() == ["ok", "failed", "ok"]
    assert "formation.rho is -1" in found.table["reason"][1]
    assert np.isnan(found.table["success"][1])
    assert found.failures == 1


@pytest.mark.parametrize("options", [{"runs": 5}, {"tolerance": 0.1}])
def test_sweep_of_a_policy_with_memory_has_its_reason(options: dict[str, Any]) -> None:
    calls = count()

    def remembering(_step: int, positions: Any, *_: Any) -> Any:
        return 0.01 * positions + 0.1 * next(calls)

    found = csw.sweep(SMALL, {"n": [2]}, remembering, **options)
    assert found.table["status"].tolist() == ["failed"]
    assert "'remembering' answers the same state differently" in found.table["reason"][0]


def test_sweep_over_n_and_spacing_places_members() -> None:
    places = SMALL.positions
    np.testing.assert_array_equal(with_parameters(SMALL, {"n": 2}).positions, places[:2])
    more = with_parameters(SMALL, {"n": 12}).positions
    np.testing.assert_array_equal(more[:3], places)
    apart = np.hypot(*(more[:, None] - more[None]).transpose(2, 0, 1)) + 9 * np.eye(12)
    assert apart.min() > 0.25
    wider = with_parameters(SMALL, {"spacing": 1.0}).positions
    np.testing.assert_allclose(wider.mean(axis=0), places.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(np.hypot(*(wider[1] - wider[0])), 1.0)


# --- nothing is lost


def test_interrupted_sweep_is_resumed_to_same_table(tmp_path: Path) -> None:
    whole = csw.sweep(SMALL, GRID, [toward], runs=20)

    def stop(task: str, done: float, total: float | None) -> None:  # noqa: ARG001
        assert total == 6
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        csw.sweep(SMALL, GRID, [toward], runs=20, checkpoint=tmp_path, progress=stop)
    with pytest.raises(CheckpointError, match="unfinished"):
        csw.sweep(SMALL, GRID, [toward], runs=20, checkpoint=tmp_path)
    with pytest.raises(CheckpointError, match=r"options\.runs: 20 there, 30 now"):
        csw.sweep(SMALL, GRID, [toward], runs=30, checkpoint=tmp_path, if_exists="resume")
    reported: list[int] = []
    resumed = csw.sweep(
        SMALL,
        GRID,
        [toward],
        runs=20,
        checkpoint=tmp_path,
        if_exists="resume",
        progress=lambda task, done, total: reported.append(done),  # noqa: ARG005
    )
    assert reported == [3, 4, 5, 6]
    assert resumed.table.to_csv() == whole.table.to_csv()


KILLED = """
import os, random, signal, sys, time
import casswarm as csw
from casswarm.studies.sweep import sweep
from pathlib import Path
import numpy, pandas, numba, scipy.stats
from slow_policy import toward

scenario, folder, kills = csw.load_scenario(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
chance = random.Random(1)
grid = {"hazard.alpha_1": [float(a) for a in range(1, 61)]}

def work(if_exists):
    return sweep(scenario, grid, [toward], runs=5, checkpoint=folder, if_exists=if_exists)

def records():
    return len(list((folder / "checkpoint").glob("point-*.npz")))

for kill in range(kills):
    before, child = records(), os.fork()
    if child == 0:
        work("resume" if kill else "error")
        os._exit(0)
    while kill % 2 and records() == before:  # half of them once something new is there
        time.sleep(0.001)
    time.sleep(chance.uniform(0.0, 0.15))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    print(records(), flush=True)
work("resume").table.to_csv(sys.argv[4], index=False)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork to begin children quickly")
def test_sweep_killed_twenty_times_loses_nothing(tmp_path: Path) -> None:
    csw.save_scenario(SMALL, tmp_path / "small.toml")
    (tmp_path / "killed.py").write_text(KILLED)
    slow = {"PYTHONPATH": str(Path(slow_policy.__file__).parent), "SLOW": "0.004"}
    printed = {}
    for kills in (20, 0):
        command = ("killed.py", "small.toml", f"folder-{kills}", kills, f"{kills}.csv")
        printed[kills] = python("-W", "default", *command, folder=tmp_path, **slow).stdout
    counts = [int(line) for line in printed[20].split()]
    assert counts == sorted(counts)
    assert len(set(counts)) > 3  # kills came in the middle of the work
    assert counts[0] < counts[-1] < 60
    assert (tmp_path / "20.csv").read_bytes() == (tmp_path / "0.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize("command", ["sweep", "simulate"])
def test_interrupted_command_is_resumed_to_same_bytes(
    tmp_path: Path, how: signal.Signals, command: str
) -> None:
    csw.save_scenario(SMALL, tmp_path / "small.toml")
    slow = os.environ | {"PYTHONPATH": str(Path(slow_policy.__file__).parent), "SLOW": "0.02"}
    base = [CASSWARM, command, "small.toml", "--policy", "slow_policy:toward"]
    if command == "sweep":
        base += ["--runs", "7", "--set", "hazard.alpha_1=1:20:20"]
    else:
        base += ["--policy", "naive", "--runs", "4000", "--workers", "2"]
    options: dict[str, Any] = {"cwd": tmp_path, "text": True, "env": slow}
    begun = subprocess.Popen([*base, "--out", "cut"], stderr=subprocess.PIPE, **options)
    records = tmp_path / "cut" / "checkpoint"
    deadline = time.monotonic() + 240
    while not list(records.glob("[0-9p]*.npz")) and time.monotonic() < deadline:
        time.sleep(0.01)
    begun.send_signal(how)
    _, reported = begun.communicate(timeout=240)
    assert begun.returncode != 0
    assert "Traceback" not in reported
    if how == signal.SIGINT:
        assert "continue with --resume" in reported
    kept = {path.name: path.stat().st_mtime_ns for path in records.glob("[0-9p]*.npz")}
    assert kept
    for more in (["--out", "cut", "--resume"], ["--out", "whole"]):
        fast = options | {"env": slow | {"SLOW": "0"}}
        subprocess.run([*base, *more], check=True, capture_output=True, **fast)
    for name, then in kept.items():
        assert (records / name).stat().st_mtime_ns == then  # not done again
    for table in (tmp_path / "whole").glob("*.csv"):
        if table.name != "effort.csv":
            assert (tmp_path / "cut" / table.name).read_bytes() == table.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(("largest", "saved"), [(4096, False), (16384, True)])
def test_full_disk_loses_no_finished_work(tmp_path: Path, largest: int, saved: bool) -> None:
    """A limit on the size of files stands for the full disk: writing raises the same way.

    Records have about 7,000 bytes, tables more: with the larger limit the records are saved.
    """
    resource = pytest.importorskip("resource")
    csw.save_scenario(SMALL, tmp_path / "small.toml")
    options = ["--runs", "300", "--policy", "naive", "--policy", "leader", "--out", "here"]
    base = [CASSWARM, "simulate", "small.toml", *options]

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    full = subprocess.run(
        base, cwd=tmp_path, capture_output=True, text=True, preexec_fn=small_files, check=False
    )
    assert full.returncode == 1, full.stderr
    assert "File too large" in full.stderr
    assert "Traceback" not in full.stderr
    assert ("free some space, then continue with --resume" in full.stderr) == saved
    assert len(list((tmp_path / "here").rglob("*.npz"))) == 2 * saved
    assert not list((tmp_path / "here").rglob(".part-*"))
    subprocess.run([*base, "--resume"], cwd=tmp_path, check=True, capture_output=True)
    assert len(pd.read_csv(tmp_path / "here" / "runs.csv")) == 600


def test_sweep_leaves_global_random_state_unchanged() -> None:
    before = random.getstate()
    csw.sweep(SMALL, {"n": [1]}, [toward], runs=2)
    assert random.getstate() == before


# --- unusual inputs


def swept(settings: dict[str, Any], **options: Any) -> pd.DataFrame:
    return csw.sweep(PAIR, settings, ["leader"], **({"tolerance": 0.1} | options)).table


def test_sweep_with_reordered_parameters_is_not_resumed(tmp_path: Path) -> None:
    swept({"n": [1, 2], "formation.rho": [0.02, 0.1]}, checkpoint=tmp_path)
    with pytest.raises(CheckpointError, match="keys"):
        swept({"formation.rho": [0.02, 0.1], "n": [1, 2]}, checkpoint=tmp_path, if_exists="resume")


def test_sweep_accepts_numpy_numbers(tmp_path: Path) -> None:
    table = swept({"n": np.arange(1, 3)}, runs=np.int64(5), checkpoint=tmp_path)
    assert table["status"].tolist() == ["ok", "ok"]
    assert table["n"].tolist() == [1, 2]


def test_sweep_accepts_single_policy() -> None:
    table = csw.sweep(PAIR, {"n": [1]}, "naive", runs=2).table
    assert table["policy"].tolist() == ["naive"]
    columns = ["success", "success_low", "success_high"]
    assert [name for name in table.columns if name in columns] == columns


def test_resumed_sweep_repeats_failed_points(tmp_path: Path) -> None:
    settings = {"formation.rho": [0.05, -1.0]}
    first = swept(settings, checkpoint=tmp_path)
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "checkpoint").glob("*.npz")}
    again = swept(settings, checkpoint=tmp_path, if_exists="resume")
    assert first["status"].tolist() == again["status"].tolist() == ["ok", "failed"]
    now = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "checkpoint").glob("*.npz")}
    assert [now[name] == kept[name] for name in sorted(kept)] == [True, False]


def test_sweep_point_with_wide_bounds_has_reason() -> None:
    table = swept({"n": [2]}, tolerance=1e-9, max_states=2)
    assert table["status"].tolist() == ["ok"]
    assert "state budget exhausted" in table["reason"][0]
    assert swept({"n": [2]})["reason"].tolist() == [""]


def test_sweep_adds_members_to_coincident_ones() -> None:
    crowd = PAIR.with_values({"swarm.positions": [[1.0, 1.0], [1.0, 1.0]]})
    positions = with_parameters(crowd, {"n": 5}).positions
    assert positions.shape == (5, 2)


def test_sweep_command_ranges_of_integers_are_integers() -> None:
    assert _values("formation.iterations=500:2000:4") == (
        "formation.iterations",
        [500, 1000, 1500, 2000],
    )
    assert _values("hazard.alpha_2=1.0:3:3") == ("hazard.alpha_2", [1.0, 2.0, 3.0])
    assert all(type(n) is int for n in _values("n=1:6:6:linear")[1])


def test_sweep_of_whole_numbers_takes_no_fractions() -> None:
    assert _values("n=1.0:3.0:3") == ("n", [1, 2, 3])
    assert all(type(n) is int for n in whole_numbers("n", np.linspace(1, 2, 2)))


def test_sweep_jobs_in_threads_take_turns() -> None:
    """CasADi's functions must not be shared by threads that run."""
    settings = {"hazard.alpha_1": [5.0, 10.0, 15.0, 20.0]}
    with ThreadPoolExecutor(4) as pool:
        threaded = swept(settings, workers=pool)
    pd.testing.assert_frame_equal(threaded, swept(settings))

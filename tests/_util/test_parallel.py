"""Work in processes, executors and Dask clusters: same numbers, and deaths that cost time alone."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import slow_policy
from commands import casswarm
from slow_policy import fatal_once, toward
from sweep_cases import GRID, SMALL

import casswarm as csw
from casswarm._util.child import done_jobs
from casswarm.errors import WorkerError

FATAL = ("simulate", "small.toml", "--policy", "slow_policy:fatal", "--runs", 4)


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Folder with a scenario and a policy of one's own."""
    csw.save_scenario(SMALL, tmp_path / "small.toml")
    shutil.copy(slow_policy.__file__, tmp_path)
    return tmp_path


def test_done_jobs_yields_indices_and_results() -> None:
    jobs = [lambda value=value: value**2 for value in range(5)]
    assert dict(done_jobs(jobs, 1)) == {0: 0, 1: 1, 2: 4, 3: 9, 4: 16}
    with ThreadPoolExecutor(2) as pool:
        assert dict(done_jobs(jobs, pool)) == {0: 0, 1: 1, 2: 4, 3: 9, 4: 16}
        assert pool.submit(int).result() == 0  # it was not shut down


@pytest.mark.slow
def test_jobs_that_are_given_up_end_quietly(monkeypatch: pytest.MonkeyPatch) -> None:
    failures: list[threading.ExceptHookArgs] = []
    monkeypatch.setattr(threading, "excepthook", failures.append)
    for _ in range(10):  # about two of ten failed while the jobs were cancelled one by one
        results = done_jobs([partial(time.sleep, 0.05) for _ in range(60)], 2)
        next(results)
        results.close()  # type: ignore[attr-defined]
    assert not failures


def test_executor_gives_same_tables_as_one_process() -> None:
    alone = csw.simulate(SMALL, ["leader", toward], 100)
    with ThreadPoolExecutor(2) as pool:
        shared = csw.simulate(SMALL, ["leader", toward], 100, workers=pool)
    pd.testing.assert_frame_equal(shared.runs, alone.runs, check_exact=True)


@pytest.mark.slow
def test_jobs_of_dead_worker_are_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FATAL", str(tmp_path / "died"))
    shared = csw.sweep(SMALL, GRID, [fatal_once], runs=20, workers=2)
    assert (tmp_path / "died").exists()
    alone = csw.sweep(SMALL, GRID, [fatal_once], runs=20)
    assert shared.table.to_csv() == alone.table.to_csv()


@pytest.mark.slow
def test_workers_that_always_die_raise() -> None:
    with pytest.raises(WorkerError, match="a worker process died"):
        list(done_jobs([exit_at_once, exit_at_once], 2))


def test_executor_whose_workers_die_raises() -> None:
    with (
        ProcessPoolExecutor(1, get_context("spawn")) as pool,
        pytest.raises(WorkerError, match="lost its workers"),
    ):
        list(done_jobs([exit_at_once], pool))


class OtherVersion(Executor):
    """An executor whose workers have another casswarm."""

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(csw, "__version__", "0.0.1", raising=False)
            try:
                future.set_result(function(*arguments, **options))
            except Exception as error:
                future.set_exception(error)
        return future


def test_worker_of_another_version_raises() -> None:
    present = csw.__version__
    with pytest.raises(
        WorkerError, match=r"worker has casswarm 0\.0\.1, and .* install the same"
    ) as e:
        csw.simulate(SMALL, [toward], 10, workers=OtherVersion())
    assert (e.value.version, e.value.worker_version) == (present, "0.0.1")
    assert csw.__version__ == present


def test_error_of_job_is_raised_unchanged() -> None:
    with (
        ProcessPoolExecutor(1, get_context("spawn")) as pool,
        pytest.raises(ZeroDivisionError),
    ):
        list(done_jobs([divide], pool))


@pytest.mark.slow
def test_command_reports_dead_workers_with_exit_code_1(small: Path) -> None:
    done = casswarm(small, *FATAL, "--workers", 2, code=1)
    assert "a worker process died, and the next one too" in done.stderr


def divide() -> float:
    return 1 / 0


def exit_at_once() -> None:
    os._exit(3)


# --- a real scheduler and real workers on loopback


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    folder = tmp_path_factory.mktemp("dask")
    place = folder / "scheduler.json"
    died = folder / "died"
    env = os.environ | {
        "PYTHONPATH": str(Path(slow_policy.__file__).parent),
        "FATAL": str(died),
        "PYTHONWARNINGS": "ignore",
    }
    common = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(place)]
    scheduler = ["-m", "distributed.cli.dask_scheduler", "--port", "0", *common]
    worker = ["-m", "distributed.cli.dask_worker", "--nthreads", "1", "--nworkers", "2", *common]
    with contextlib.ExitStack() as stack:
        for command in (scheduler, worker):
            log = stack.enter_context((folder / f"{command[1]}.log").open("w"))
            process = subprocess.Popen(
                [sys.executable, *command], cwd=folder, env=env, stdout=log, stderr=log
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
        import distributed

        with distributed.Client(
            scheduler_file=str(place), set_as_default=False, timeout=60
        ) as client:
            client.wait_for_workers(2, timeout=60)
            yield str(client.scheduler.address)


@pytest.mark.slow
def test_dask_with_dead_worker_gives_same_tables(cluster: str) -> None:
    import distributed

    alone = csw.sweep(SMALL, GRID, [toward], runs=20)
    study = csw.simulate(SMALL, [toward, "leader"], 100)
    with distributed.Client(cluster, set_as_default=False) as client:
        pool = client.get_executor(pure=False, retries=3)
        shared = csw.sweep(SMALL, GRID, [toward], runs=20, workers=pool)
        hurt = csw.sweep(SMALL, GRID, [fatal_once], runs=20, workers=pool)
        runs = csw.simulate(SMALL, [toward, "leader"], 100, workers=pool).runs
    pd.testing.assert_frame_equal(runs, study.runs, check_exact=True)
    assert shared.table.to_csv() == alone.table.to_csv()
    expected = alone.table.assign(policy="fatal_once")
    assert hurt.table.to_csv() == expected.to_csv()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "options", "tables"),
    [
        ("sweep", ("--runs", 9, "--set", "n=1,2,3"), ["sweep.csv"]),
        ("simulate", ("--runs", 50, "--policy", "naive"), ["runs.csv", "summary.csv"]),
    ],
)
def test_command_runs_on_dask_cluster(
    cluster: str, small: Path, command: str, options: tuple[object, ...], tables: list[str]
) -> None:
    arguments = (command, "small.toml", "--policy", "leader", *options)
    casswarm(small, *arguments, "--out", "here")
    casswarm(small, *arguments, "--out", "there", "--dask", cluster)
    for table in tables:
        assert (small / "here" / table).read_bytes() == (small / "there" / table).read_bytes()


@pytest.mark.slow
def test_command_reports_lost_cluster_with_exit_code_1(cluster: str, small: Path) -> None:
    done = casswarm(small, *FATAL, "--dask", cluster, code=1)
    assert "the executor lost its workers" in done.stderr

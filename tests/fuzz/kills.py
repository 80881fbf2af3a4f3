"""Studies that are killed and resumed until they finish, and their tables."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import pandas as pd

CASSWARM = Path(sys.executable).parent / "casswarm"
HELPERS = Path(__file__).resolve().parents[1] / "helpers"

STUDIES: dict[str, tuple[str, ...]] = {
    "sweep": (
        *("sweep", "small.toml", "--runs", "5", "--dpi", "30"),
        *("--policy", "slow_policy:toward", "--set", "hazard.alpha_1=1:12:12"),
    ),
    "simulate": (
        *("simulate", "small.toml", "--runs", "200", "--dpi", "30"),
        *("--policy", "naive", "--policy", "slow_policy:toward"),
        *("--policy", "leader", "--policy", "constrained"),
    ),
    "compare": (
        *("compare", "--family", "quick", "--dpi", "30", "--time-limit", "30"),
        *("--solver", "spectral", "--solver", "slsqp"),
    ),
}
"""Small studies with several records."""

_NEW = {"simulate": [[], ["--workers", "2"]], "sweep": [[], ["--workers", "2"]], "compare": [[]]}
_SLOW = {"simulate": "0.3", "sweep": "0.1", "compare": "0"}  # seconds of a decision
_SIGNALS = (signal.SIGKILL,) * 4 + (signal.SIGINT, signal.SIGTERM)
_TIMED = {  # tables that depend on durations throughout
    "simulate": {"effort.csv"},
    "sweep": {"effort.csv"},
    "compare": {"summary.csv", "ranking.csv", "sensitivity.csv"},
}
_TIMES = ("seconds", "time", "solves", "fastest")
"""Parts of names of columns of durations, and what depends on them, which no two runs share."""

MOST = 12
"""Number of times that a study is killed at most."""

_TIME_LIMIT = 300.0  # seconds of a command that is not killed


@dataclass
class Study:
    """A study that is killed: how often it was, with which records, and what is wrong."""

    command: str
    kills: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


@cache
def undisturbed(command: str, folder: Path) -> dict[str, str]:
    """Tables of a study that nobody interrupts, by name."""
    done = subprocess.run(
        [CASSWARM, *STUDIES[command], "--out", f"whole-{command}"],
        cwd=folder,
        env=_environment("0"),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{command} failed: {done.stderr}")
    return tables(folder / f"whole-{command}", command)


def tables(folder: Path, command: str) -> dict[str, str]:
    """Tables of a results folder as text, without durations."""
    found = {}
    for path in sorted(folder.glob("*.csv")):
        if path.name in _TIMED[command]:
            continue
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
        timed = [name for name in table if any(part in name for part in _TIMES)]
        found[path.name] = table.drop(columns=timed).to_csv(index=False)
    return found


def killed_study(number: int, seed: int, most: int, folder: Path) -> Study:
    """A study that is killed at random, resumed, and compared with an undisturbed one."""
    rng, study = Random(f"{seed}:kill:{number}"), Study(list(STUDIES)[number % len(STUDIES)])
    out, expected = folder / f"kill-{number}", undisturbed(study.command, folder)
    for _ in range(min(most, rng.randint(1, MOST))):
        if not _killed(study, out, rng):
            break
    process = _start(study.command, out, [], "0")
    _, error = _finished(process, study)
    if process.returncode:
        study.faults.append(f"ended with {process.returncode}: {error.strip()[-500:]}")
    else:
        found = tables(out, study.command)
        different = [
            name for name in found.keys() | expected if found.get(name) != expected.get(name)
        ]
        study.faults += [f"{name} differs" for name in sorted(different)]
    leftovers = [p.name for p in out.rglob(".part-*")]
    study.faults += [f"left {name}" for name in leftovers]
    return study


def _environment(slow: str) -> dict[str, str]:
    paths = filter(None, (os.environ.get("PYTHONPATH"), str(HELPERS)))
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths), "SLOW": slow}


def _start(command: str, out: Path, options: list[str], slow: str) -> subprocess.Popen[str]:
    resume = [] if command == "compare" else ["--resume"]
    return subprocess.Popen(
        [CASSWARM, *STUDIES[command], *options, *resume, "--out", out],
        cwd=out.parent,
        env=_environment(slow),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _killed(study: Study, out: Path, rng: Random) -> bool:
    """Start the study, and end it by a signal: after a new record, or at any time.

    False if it finished before.
    """
    how, after_record = rng.choice(_SIGNALS), rng.random() < 0.7
    options, slow = rng.choice(_NEW[study.command]), _SLOW[study.command]
    wait = rng.uniform(0.0, 2.0 if after_record else 8.0)
    before = _records(out)
    process = _start(study.command, out, options, slow)
    if after_record:
        _await_record(process, out, before)
    with suppress(subprocess.TimeoutExpired):
        process.wait(wait)
    finished = process.poll() is not None
    process.send_signal(how)
    _, error = _finished(process, study)
    if finished:
        if process.returncode:
            study.faults.append(f"ended with {process.returncode}: {error[-500:]}")
        return False
    new = _records(out) - before
    study.kills.append(f"{how.name}/{new}")
    if how is not signal.SIGINT and process.returncode not in (0, -how):
        study.faults.append(f"{how.name} ended it with {process.returncode}: {error[-500:]}")
    if how is signal.SIGINT and new and "Traceback" in error:
        study.faults.append(f"Ctrl-C prints a traceback: {error[-1500:]}")
    return True


def _await_record(process: subprocess.Popen[str], out: Path, before: int) -> None:
    deadline = time.monotonic() + 60
    while _records(out) <= before and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)


def _records(out: Path) -> int:
    return len(list((out / "checkpoint").glob("[!.]*.npz")))


def _finished(process: subprocess.Popen[str], study: Study) -> tuple[Any, str]:
    """Output of a process that ended; it and all that it started have to be gone soon."""
    try:
        output = process.communicate(timeout=_TIME_LIMIT)
    except subprocess.TimeoutExpired:
        study.faults.append(f"hangs: more than {_TIME_LIMIT:g} s, or a process that it left does")
        os.killpg(process.pid, signal.SIGKILL)
        output = process.communicate()
    deadline = time.monotonic() + 30
    while _group_lives(process.pid):
        if time.monotonic() > deadline:
            study.faults.append("left a process running for 30 s")
            os.killpg(process.pid, signal.SIGKILL)
            break
        time.sleep(0.05)
    return output


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except (ProcessLookupError, PermissionError):
        return False
    return True

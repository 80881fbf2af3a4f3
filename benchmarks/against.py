"""Two versions of casswarm in pairs: the checkout's, and that of a given commit.

Run with the installed package, in a checkout::

    python benchmarks/against.py HEAD~1                       # all cases, some minutes
    python benchmarks/against.py v0.1.0 plan leader-1 --pairs 21

Each version runs each case in a process of its own; a case is repeated until a measurement takes
50 ms, and the processes take turns. The table has the median time of both, and the median ratio of
the pairs, checkout / commit, with its quartiles, in wall-clock and in processor time, and the peaks
of memory. A case is slower if the lower quartiles of both ratios exceed 1.05: the exit status is
then 1. Answers are not compared.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from _cases import CASES
from _timing import print_table

ROOT = Path(__file__).parents[1]
SLOWER = 1.05
SECONDS = 0.05


class Version:
    """A process that runs cases with one version of casswarm."""

    def __init__(self, folder: Path | None) -> None:
        environment = dict(os.environ, OPENBLAS_NUM_THREADS="1")
        if folder is not None:
            environment["PYTHONPATH"] = str(folder)
            environment["CASSWARM_CACHE"] = str(folder / "compiled")
        self._process = subprocess.Popen(
            [sys.executable, "-W", "ignore", str(ROOT / "benchmarks" / "_cases.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )

    def ask(self, request: str) -> dict[str, Any]:
        """The answer to a request; an error if the process has ended."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(request + "\n")
            process.stdin.flush()
        except BrokenPipeError:
            return {"error": f"its process ended ({process.wait()})"}
        line = process.stdout.readline()
        return json.loads(line) if line else {"error": f"its process ended ({process.wait()})"}

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


@contextmanager
def started(folders: Sequence[Path | None]) -> Iterator[list[Version]]:
    """A process of each version; None is the checkout's."""
    versions = [Version(folder) for folder in folders]
    try:
        yield versions
    finally:
        for version in versions:
            version.end()


def install(revision: str, folder: Path) -> Path:
    """Install a commit's casswarm, without dependencies, in a folder; its path."""
    source, target = folder / "source", folder / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    for command in (
        ["git", "-C", str(ROOT), "worktree", "add", "--detach", "--quiet", str(source), revision],
        [*pip, "--target", str(target), str(source)],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{revision} cannot be installed: {done.stderr.strip()}")
    return target


def row(name: str, versions: Sequence[Version], pairs: int) -> tuple[list[str], bool]:
    """Time a case in both versions; its cells, and whether the checkout is slower."""
    ready = [version.ask(f"prepare {name}") for version in versions]
    calls = max(1, round(SECONDS / max(ready[0].get("wall", SECONDS), 1e-6)))
    times: list[list[dict[str, Any]]] = []
    for _ in range(pairs if not any("error" in answer for answer in ready) else 0):
        times.append([version.ask(f"run {calls}") for version in versions])
        ready = times[-1]
        if any("error" in answer for answer in ready):
            break
    for answer, which in zip(ready, ("checkout", "commit"), strict=True):
        if "error" in answer:
            return [name, "", "", "", "", "", f"{which}: {answer['error']}"], False
    wall, cpu = ([[one[key] for one in pair] for pair in times] for key in ("wall", "cpu"))
    ratios = [
        np.quantile([own / other for own, other in each], (0.25, 0.5, 0.75)) for each in (wall, cpu)
    ]
    slower = all(ratio[0] > SLOWER for ratio in ratios)
    cells = [f"{middle:.2f} ({low:.2f} to {high:.2f})" for low, middle, high in ratios]
    medians = [f"{1e3 * median:.3g} ms" for median in np.median(wall, axis=0)]
    cells.append(" / ".join(f"{answer['peak']:.0f}" for answer in ready))
    faster = all(ratio[2] < 1 / SLOWER for ratio in ratios)
    return [name, *medians, *cells, "slower" if slower else "faster" if faster else ""], slower


def main() -> None:
    """Print the table; exit with status 1 if a case is slower."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("revision", help="commit, tag or branch to compare with")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"{', '.join(CASES)}; all")
    parser.add_argument("--pairs", type=int, default=9, help="pairs of measurements, 9")
    options = parser.parse_args()
    if unknown := set(options.cases) - set(CASES):
        parser.error(f"unknown case {', '.join(sorted(unknown))}; known: {', '.join(CASES)}")
    if options.pairs < 1:
        parser.error("--pairs must be at least 1")
    slow: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        try:
            folders = None, install(options.revision, Path(temporary))
            with started(folders) as versions:
                for which, version in zip(("checkout", "commit"), versions, strict=True):
                    print(f"{which}: {version.ask('version 0')['version']}")
            print_table(
                ("case", "checkout", "commit", "ratio of times", "of processor time", "MB", ""),
                rows(options.cases or list(CASES), folders, options.pairs, slow),
            )
        finally:
            source = str(Path(temporary) / "source")
            subprocess.run(
                ["git", "-C", str(ROOT), "worktree", "remove", "--force", source],
                check=False,
                capture_output=True,
            )
    if slow:
        sys.exit(f"slower than {options.revision}: {', '.join(slow)}")


def rows(
    names: Sequence[str], folders: Sequence[Path | None], pairs: int, slow: list[str]
) -> Iterator[list[str]]:
    """Rows of the table; names of cases that are slower are added to `slow`."""
    for name in names:
        with started(folders) as versions:
            cells, slower = row(name, versions, pairs)
        if slower:
            slow.append(name)
        yield cells


if __name__ == "__main__":
    main()

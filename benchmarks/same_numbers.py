"""Tables of the commands, compared as numbers with those of a given commit.

Run with the installed package, in a checkout::

    python benchmarks/same_numbers.py v0.1.0
    python benchmarks/same_numbers.py HEAD~1 plan-paper-1 sweep --tolerance 1e-9

Every command runs with both versions, and every CSV file that it writes is compared: the same
columns and rows, the same texts, and numbers whose largest relative difference is shown. Columns of
times are left out. The exit status is 1 where a difference exceeds the tolerance, 0 by default.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from _timing import print_table
from against import ROOT, install

COMMANDS = {
    "plan-paper-1": "plan paper-1",
    "plan-barricade": "plan barricade",
    "plan-gauntlet": "plan gauntlet",
    "plan-swarm": "plan-swarm alley",
    "simulate-paper-1": "simulate paper-1 --runs 300 --policy leader --policy constrained",
    "simulate-paper-2": "simulate paper-2 --runs 200 --policy leader",
    "simulate-joint": "simulate alley --runs 200 --policy joint --policy naive",
    "evaluate": "evaluate paper-1 --policy leader --policy naive",
    "evaluate-alley": "evaluate alley --policy leader",
    "sweep": "sweep paper-1 --set n=2,3 --policy leader --runs 50",
    "horizon": "simulate paper-1 --runs 20 --policy leader-mpc-3",
    "reproduce": "reproduce --runs 50 --only table-2 --no-figures",
}
TIMES = ("seconds", "microseconds", "build", "time")


def tables(command: str, folder: Path, package: Path | None) -> dict[str, pd.DataFrame]:
    """CSV files that a command writes, by name."""
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1")
    if package is not None:
        environment |= {"PYTHONPATH": str(package), "CASSWARM_CACHE": str(package / "compiled")}
    words = [*command.split(), *([] if "reproduce" in command else ["--no-figures"])]
    run = [sys.executable, "-W", "ignore", "-m", "casswarm", *words]
    folder.mkdir(parents=True)
    done = subprocess.run(
        run, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"casswarm {command} failed: {done.stderr.strip()[-500:]}")
    found = sorted((folder / "results").rglob("*.csv"))
    return {path.name: pd.read_csv(path) for path in found}


def difference(own: pd.DataFrame, other: pd.DataFrame) -> float:
    """Largest relative difference of two tables; infinite where their form or texts differ."""
    if list(own.columns) != list(other.columns) or len(own) != len(other):
        return float("inf")
    largest = 0.0
    for column in own.columns:
        if any(word in column for word in TIMES):
            continue
        if not all(pd.api.types.is_numeric_dtype(each[column]) for each in (own, other)):
            if not own[column].astype(str).equals(other[column].astype(str)):
                return float("inf")
            continue
        a, b = (each[column].to_numpy(float) for each in (own, other))
        if (np.isnan(a) != np.isnan(b)).any():
            return float("inf")
        scale = np.maximum(np.maximum(abs(a), abs(b)), 1e-300)
        changed = np.where(a == b, 0.0, abs(a - b) / scale)
        largest = max(largest, float(np.nanmax(changed, initial=0.0)))
    return largest


def main() -> None:
    """Print the table; exit with status 1 if a number differs by more than the tolerance."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("revision", help="commit, tag or branch to compare with")
    parser.add_argument("commands", nargs="*", metavar="COMMAND", help=", ".join(COMMANDS))
    parser.add_argument("--tolerance", type=float, default=0.0, help="relative difference, 0")
    options = parser.parse_args()
    if unknown := set(options.commands) - COMMANDS.keys():
        parser.error(f"unknown {', '.join(sorted(unknown))}; known: {', '.join(COMMANDS)}")
    worst, rows = 0.0, []
    with tempfile.TemporaryDirectory() as temporary:
        try:
            package = install(options.revision, Path(temporary))
            for name in options.commands or COMMANDS:
                own = tables(COMMANDS[name], Path(temporary, "own", name), None)
                other = tables(COMMANDS[name], Path(temporary, "other", name), package)
                if own.keys() != other.keys():
                    raise SystemExit(f"{name}: files {sorted(own)}, before {sorted(other)}")
                found = {file: difference(own[file], other[file]) for file in own}
                worst = max([worst, *found.values()])
                rows += [[name, file, f"{value:.2g}"] for file, value in found.items()]
                print(name, found, file=sys.stderr, flush=True)
        finally:
            remove = ["git", "-C", str(ROOT), "worktree", "remove", "--force"]
            source = str(Path(temporary) / "source")
            subprocess.run([*remove, source], check=False, capture_output=True)
    print_table(("command", "table", "largest relative difference"), rows)
    if worst > options.tolerance:
        sys.exit(f"numbers differ by up to {worst:.2g}")


if __name__ == "__main__":
    main()

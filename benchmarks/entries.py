"""Verify entries of the leaderboards: measure what their manifests claim.

Run with the installed package and what the manifests require::

    python benchmarks/entries.py results/leaderboard/entries/ipopt.toml
    python benchmarks/entries.py results/leaderboard/entries/*.toml

A manifest is a TOML file of ten lines, such as these. `source` names a function or class
"module:name", in the folder of the manifest, in that of this file, or installed: of a policy, a
function of a scenario and a guide that returns it; of a solver, what returns a
`casswarm.solvers.Solver` when it is called. `claims` are least values: of a policy, the success in
a built-in scenario, of which the lower end of the bounds is compared; of a solver, the fraction of
the problems of a family of `casswarm compare` that it solves from their own starts.

Code of an entry is run. Prints a row for every claim; the exit status is 1 if one does not hold.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from _timing import print_table
from leaderboard import own_function, regret, success_of, success_text

import casswarm as csw

KEYS = {
    "kind": str,
    "name": str,
    "source": str,
    "summary": str,
    "authors": list,
    "licence": str,
    "requires": list,
    "claims": dict,
}
COLUMNS = ("entry", "on", "claimed", "measured", "score", "holds")


def manifest(path: Path) -> dict[str, Any]:
    """What a manifest says, which is checked."""
    try:
        entry = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: {error}") from None
    if wrong := KEYS.keys() ^ entry.keys():
        raise SystemExit(f"{path}: its keys are {', '.join(KEYS)}; not {', '.join(sorted(wrong))}")
    for key, kind in KEYS.items():
        if not isinstance(entry[key], kind):
            raise SystemExit(f"{path}: {key} is no {kind.__name__}")
    claims = entry["claims"].values()
    if not claims or not all(isinstance(each, int | float) and 0 <= each <= 1 for each in claims):
        raise SystemExit(f"{path}: claims are one or more numbers from 0 to 1")
    if entry["kind"] not in MEASURES:
        raise SystemExit(f"{path}: kind is {' or '.join(MEASURES)}, not {entry['kind']}")
    return entry


def of_policy(made: Any, name: str) -> tuple[float, str, str]:
    """Success in a scenario: its lower end, both ends in words, and the regret."""
    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario)
    found = success_of(scenario, csw.as_policy(made(scenario, guide)), guide)
    return found["success_low"], success_text(found), f"regret {regret(found):.3f}"


def of_solver(made: Any, family: str) -> tuple[float, str, str]:
    """Problems of a family that a solver solves: fraction, number, and time."""
    runs = csw.compare(family, [made()]).runs
    runs = runs[(runs["start"] == "cold") & runs["applicable"]]
    solved, milliseconds = runs["solved"].mean(), 1e3 * runs["solve_seconds"].median()
    number = f"{runs['solved'].sum()} of {len(runs)} problems"
    return float(solved), number, f"{milliseconds:.1f} ms, median"


MEASURES = {"policy": of_policy, "solver": of_solver}


def rows(path: Path) -> Iterator[list[Any]]:
    """A row for every claim of an entry."""
    entry = manifest(path)
    made = own_function(entry["source"], path.parent)
    for name, claimed in entry["claims"].items():
        value, measured, score = MEASURES[entry["kind"]](made, name)
        yield [entry["name"], name, claimed, measured, score, "yes" if value >= claimed else "no"]


def main() -> None:
    """Verify the entries of the command line."""
    paths = [Path(each) for each in sys.argv[1:]]
    if not paths:
        raise SystemExit("usage: entries.py MANIFEST...")
    for path in paths:
        manifest(path)  # before the measurements
    found = [row for path in paths for row in rows(path)]
    print_table(COLUMNS, found)
    if any(row[-1] == "no" for row in found):
        raise SystemExit(1)


if __name__ == "__main__":
    main()

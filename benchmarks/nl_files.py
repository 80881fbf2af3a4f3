"""Solvers on a folder of .nl files of the Hock-Schittkowski problems, against the published optima.

Run in a checkout, with the installed package and a folder of files hs001.nl, hs1.nl or the like::

    OPENBLAS_NUM_THREADS=1 python benchmarks/nl_files.py FOLDER                    # some minutes
    OPENBLAS_NUM_THREADS=1 python benchmarks/nl_files.py FOLDER ipopt --out runs.csv

Prints the files that are refused, with reasons, and a Markdown table. For every solver it has the
files, how many of them it solved, with residuals that are recomputed from the problem, and where
its answers are: at the published optimum (to a relative 1e-4, since some are published with few
digits), below or above it, or of a file without a published number; then the answers that are
reported as solved but not verified. What is not at the published optimum is listed after the table.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from _timing import print_table

import casswarm as csw

DIGITS = 1e-4
SOLVERS = ("ipopt", "interior-point", "sqp", "slsqp")
COLUMNS = (
    "solver",
    "files",
    "solved",
    "published optimum",
    "below",
    "above",
    "not published",
    "false successes",
)

# W. Hock, K. Schittkowski, Test Examples for Nonlinear Programming Codes, Springer, 1981
_FIRST = (
    *(0, 0.0504261879, 0, 8 / 3, -1.91322295, 0, -1.73205081, -1, -0.5, -1),
    *(-8.498464223, -30, 1, 1.39346498, 306.5, 0.25, 1, 5, -6961.81381, 38.19873),
    *(-99.96, 1, 2, -1, 0, 0, 0.04, 0, -22.627417, 1),
    *(6, 1, -4.585786, -0.83403244, 1 / 9, -3300, -3456, 0, -1, -0.25),
    *(1.92592593, 13.8578644, -44, -15, 1, 0, 0, 0, 0, 0),
    *(0, 5.32664756, 4.09302326, -0.90807476, 19 / 3, -3.456, 0.02845967),
)
PUBLISHED = dict(enumerate(_FIRST, start=1))
PUBLISHED |= {
    **{59: -7.80423595, 60: 0.03256820, 61: -143.6461422, 62: -26272.51448, 63: 961.7151721},
    **{64: 6299.842428, 65: 0.9535288567, 66: 0.5181632741, 67: -1162.03651, 68: -0.9204250},
    **{69: -956.71288, 70: 0.007498464, 71: 17.0140173, 72: 727.67937, 73: 29.894378},
    **{74: 5126.4981, 75: 5174.4129, 76: -4.681818181, 77: 0.24150513, 78: -2.91970041},
    **{79: 0.0787768209, 80: 0.0539498478, 81: 0.0539498478, 83: -30665.53867},
    **{84: -5280335.133, 85: -1.90513375, 86: -32.34867897, 87: 8927.5977, 93: 135.075961},
    **dict.fromkeys((88, 89, 90, 91, 92), 1.36265681),
    **{95: 0.015619514, 96: 0.015619514, 97: 3.1358091, 98: 3.1358091, 99: -831079892},
    **{100: 680.6300573, 101: 1809.76476, 102: 911.880571, 103: 543.667958},
    **{104: 3.9511634396, 105: 1138.416240, 106: 7049.330923, 107: 5055.011803},
    **{108: -0.8660254038, 109: 5362.06928, 110: -45.77846971, 111: -47.75997},
    **{112: -47.707579, 113: 24.3062091, 114: -1768.80696, 116: 97.588409},
    **{117: 32.34867897, 118: 664.82045, 119: 244.899698},
}


def number_of(name: str) -> int:
    """Number of the problem of a file's name; 0 for variants, such as hs21mod."""
    found = re.fullmatch(r"hs0*(\d+)", name, re.IGNORECASE)
    return int(found[1]) if found else 0


def place(row: pd.Series) -> str:
    """Where an answer is with respect to the published optimum; empty if it is none."""
    if not row["solved"]:
        return ""
    optimum = PUBLISHED.get(number_of(row["problem"]))
    if optimum is None:
        return "not published"
    difference = (row["objective"] - optimum) / max(1.0, abs(optimum))
    if abs(difference) <= DIGITS:
        return "published optimum"
    return "below" if difference < 0 else "above"


def table(runs: pd.DataFrame) -> Iterator[tuple[object, ...]]:
    """A row per solver."""
    for solver, part in runs.groupby("solver", sort=False):
        places = part["place"].value_counts()
        counts = [int(places.get(column, 0)) for column in COLUMNS[3:7]]
        false = part["reported_success"] & ~part["solved"]
        yield solver, len(part), int(part["solved"].sum()), *counts, int(false.sum())


def study(folder: Path, solvers: list[str], time_limit: float) -> pd.DataFrame:
    """Runs of the solvers on all files of a folder, with the place of every answer."""
    problems = csw.read_problems([folder], refused=lambda error: print(f"refused: {error}\n"))
    runs = csw.compare(problems, solvers, time_limit=time_limit, progress=True).runs
    return runs.assign(place=runs.apply(place, axis=1))


def main() -> None:
    """Read the arguments, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("solvers", nargs="*", default=list(SOLVERS))
    parser.add_argument("--time-limit", type=float, default=10.0, help="seconds of a solve")
    parser.add_argument("--out", type=Path, help="file for all runs, as CSV")
    options = parser.parse_args()
    try:
        runs = study(options.folder, options.solvers, options.time_limit)
    except csw.CasswarmError as error:
        parser.error(str(error))
    if options.out:
        runs.to_csv(options.out, index=False)
    print_table(COLUMNS, table(runs))
    others = runs[~runs["place"].isin(["published optimum", "not published"])]
    for solver, part in others.groupby("solver", sort=False):
        listed = (
            f"{row.problem} ({row.place or row.status} {row.objective:.7g})"
            for row in part.itertuples()
        )
        print(f"{solver}: {', '.join(listed)}\n")


if __name__ == "__main__":
    main()

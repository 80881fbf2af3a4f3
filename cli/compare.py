"""casswarm compare."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

import casswarm as csw

from .._util.parts import Part
from .common import named_solver, work
from .options import (
    COUNT,
    POSITIVE,
    ResultOptions,
    allow_code_option,
    option,
    options,
    out_option,
    part_option,
    policy_option,
    refuse,
    scenario_argument,
    seed_option,
    solver_option,
)
from .output import say

if TYPE_CHECKING:
    from ..comparison import Agreement
    from ..comparison.report import Report
    from ..results.folder import ResultsFolder


@dataclass(frozen=True)
class CompareOutput(ResultOptions):
    """Options of written and printed output."""

    out: Path | None = out_option("[default: results/compare]")


@dataclass(frozen=True)
class CompareOptions:
    """Problems and solvers."""

    scenarios: tuple[str, ...] = scenario_argument(metavar="[SCENARIO]...")
    families: tuple[str, ...] = option(
        "Family of random problems: guides, formations, or quick for a short comparison. "
        "Repeatable. [default: guides and formations, if no other problems are given]",
        "--family",
        metavar="NAME",
    )
    problems: tuple[Path, ...] = option(
        "File in AMPL's .nl format, or folder of such files. Repeatable.", metavar="PATH"
    )
    policies: tuple[str, ...] = policy_option(
        "Policy whose formation problems in the scenarios are solved. Repeatable. "
        "[default: leader, constrained]"
    )
    solvers: tuple[str, ...] = solver_option(
        "Solver to compare; casswarm solvers lists them. Your own as module:Class. Repeatable. "
        "[default: all]",
        metavar="NAME",
    )
    count: int | None = option(
        "Number of problems of every kind in a family, or of guides and of states for every policy "
        "of a scenario. [default: 3, of quick 1]",
        type=COUNT,
    )
    copies: int = option(
        "Number of perturbed copies of every problem: other initial guesses, orders and units, on "
        "which a result should not depend. The time grows with 1 + COPIES.",
        type=click.IntRange(0),
        default=0,
    )
    seed: int = seed_option()
    time_limit: float = option(
        "Time limit for building and solving a problem once, in seconds; a slower solver is "
        "stopped. What its process does only once, such as imports and compilation, does not "
        "count: a small problem is solved first, untimed.",
        type=POSITIVE,
        default=2.0,
    )
    no_iterates: bool = option(
        "Do not solve every problem once more, untimed, to record the iterates of solvers that "
        "report them."
    )
    against: Path | None = option(
        "Say whether the ranking agrees with that of an earlier comparison in this folder, within "
        "the error bars of both.",
        metavar="FOLDER",
    )
    part: Part | None = part_option()
    allow_code: bool = allow_code_option()

    def __post_init__(self) -> None:
        if not self.scenarios:
            refuse("no scenario is given", "policies", "allow_code")
        if self.problems and not (self.scenarios or self.families):
            refuse("all problems are those of files", "count")


@click.command()
@options
def compare(selection: CompareOptions, output: CompareOutput) -> None:
    """Compare solvers on problems from real runs, or on your own.

    The problems are those that planning and simulating the SCENARIOs pose to their solver, those of
    files in AMPL's .nl format, or those of random scenarios.

    Reports success rate, speed and reliability. Each solver runs in a process of its own: one that
    crashes or hangs is a row of the tables. Every solution is verified by residuals recomputed from
    the problem. Solvers are ranked by mean time, with 95 % intervals and the probability of each
    rank from resampling the problems. Prints a summary and writes report.html and report.md, the
    tables runs.csv (a row per problem, copy, start and solver), traits.csv (of the problems),
    iterates.csv (objective and violation at the iterates that solvers report), summary.csv,
    ranking.csv, sensitivity.csv, problems.csv and failures.csv, figures (in report.html always
    PNG), and run.json; with --no-figures no report, which shows them.

    Results are saved incrementally: repeat an interrupted command with the same options to continue
    it. The default takes five to ten minutes. A comparison repeated on another day, in another
    folder, should agree with the first: see --against.

    \b
    Examples:
      casswarm compare --family quick
      casswarm compare
      casswarm compare --family formations --solver spectral --solver ipopt --count 10
      casswarm compare --family quick --count 5 --copies 3
      casswarm compare mine.toml ring --solver ipopt --solver my_module:MySolver
      casswarm compare --problems my-problems/ --solver ipopt --solver slsqp
      casswarm compare --out results/compare-again --against results/compare
    """
    with work(output, resume="repeat the same command to continue") as job:
        earlier = None if selection.against is None else csw.Comparison.load(selection.against)
        folder = job.open("compare", since=0.0)
        if selection.against and selection.against.resolve() == folder.path.resolve():
            raise csw.ComparisonError(
                f"--against {selection.against} is the folder of the results: choose another with "
                "--out"
            )
        solvers = list(map(named_solver, selection.solvers)) or None
        comparison = csw.compare(
            _problems(selection, output.quiet),
            solvers,
            count=selection.count,
            copies=selection.copies,
            seed=selection.seed,
            time_limit=selection.time_limit,
            record_iterates=not selection.no_iterates,
            checkpoint=job.checkpoint(selection.part),
            if_exists="resume",
            progress=job.progress,
        )
        job.prepare_figures()
        _write_tables(folder, comparison)
        text = str(comparison)
        if earlier is not None:
            agreement = job.attempt("agreement", partial(_agreement, folder, comparison, earlier))
            text += f"\n\n{selection.against}: {agreement}" if agreement else ""
        if not output.no_figures:
            from ..comparison.report import make_report

            report = job.attempt("the report", partial(make_report, comparison))
            if report is not None:
                job.draw(lambda: dict(report.figures))
                job.attempt("the report", partial(_write_pages, folder, report))
        job.finish(text)


def _problems(selection: CompareOptions, quiet: bool) -> list[str | csw.Problem]:
    """Families by name, and problems of scenarios and files; files of folders can be left out."""
    from ..comparison import DEFAULT

    posed: list[str | csw.Problem] = list(selection.families)
    policies = selection.policies or ("leader", "constrained")
    for name in selection.scenarios:
        scenario = csw.load_scenario(name, allow_code=selection.allow_code)
        count = selection.count or 3
        posed += csw.guide_problems(scenario, count, selection.seed)
        if scenario.n > 1:  # a lone agent has no formation
            posed += csw.formation_problems(scenario, policies, count, seed=selection.seed)
    posed += csw.read_problems(selection.problems, lambda e: say(f"left out: {e}", quiet))
    return posed or list(DEFAULT)


def _agreement(
    folder: ResultsFolder, comparison: csw.Comparison, earlier: csw.Comparison
) -> Agreement:
    """Compare both; write the agreement as a table, and add it to the record."""
    agreement = comparison.agreement(earlier)
    folder.write_tables(agreement=agreement.table)
    result = {
        "agrees": agreement.agrees,
        "summary": agreement.summary.to_dict("records"),
        "different": agreement.different,
    }
    folder.record = {**folder.record, "agreement": result}
    folder.extend_record()
    return agreement


def _write_tables(folder: ResultsFolder, comparison: csw.Comparison) -> None:
    from ..comparison.report import report_tables

    tables = report_tables(comparison)
    folder.write_tables(**tables)
    names = ("summary", "ranking", "failures")
    result = {name: tables[name].to_dict("records") for name in names}
    folder.write_record(result, comparison.inputs)


def _write_pages(folder: ResultsFolder, report: Report) -> None:
    suffix = folder.figure_format.suffix
    folder.write_file("report.md", report.markdown(suffix))
    drawn = report.figures if suffix == "png" else ()  # not to draw them twice
    images = {name: (folder.path / f"{name}.png").read_bytes() for name in drawn}
    folder.write_file("report.html", report.html(images))
    folder.extend_record()

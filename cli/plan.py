"""casswarm plan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import click

import casswarm as csw

from .._util.text import counted
from . import completion
from .common import WrongInput, load, reported_errors
from .ending import Ending
from .log import show_log, shown_solvers
from .options import CommonOptions, GuideOptions, Number, VerboseOptions, option, options, refuse
from .output import open_folder, progress_report

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


_MAX_CLASSES = 6  # that are printed; candidates.csv has them all


def plan_text(scenario: csw.Scenario, guide: csw.Guide, baseline: csw.Guide | None) -> str:
    """The guide, its certificate and its solve, and a global search for comparison if any."""
    radars = len(scenario.hazard.radar_positions)
    lines = [
        f"{scenario.name}: {counted(scenario.n, 'member')}, {counted(radars, 'radar')}, "
        f"{counted(scenario.n_steps, 'step')} of {scenario.time.dt:g}",
        f"{guide}",
        f"risk {guide.risk:.4f}",
        *_certificate(scenario, guide),
        f"{guide.solution}",
        f"solves: {', '.join(f'{count} {status}' for status, count in guide.outcomes.items())}",
        *_homotopy_classes(guide),
    ]
    if baseline is not None:
        risk = f"risk {baseline.risk:.4f}"
        lines.append(f"a global search without a_max and margin: {baseline}, {risk}")
    elif not guide.solution.status.success:
        lines.append("the solver did not converge: this is its best iterate, not a minimum")
    else:
        lines += _limits(scenario, guide)
    return "\n".join(lines)


def _limits(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[str]:
    """What limited the search for the guide, and the options without these limits."""
    limits = {}
    if guide.search == "local":
        limits["a local search"] = "--search global"
    if scenario.guide.arrival == "horizon":
        limits["arrival at the last step"] = "--arrival any"
    if limits:
        options = " ".join(limits.values())
        yield f"limited to {' and '.join(limits)}: {options} may find a better path"


def _homotopy_classes(guide: csw.Guide) -> Iterator[str]:
    """The best path of every homotopy class, unless there is only one class."""
    paths = guide.best_per_homotopy_class()
    if len(paths) < 2 or not paths[0].homotopy:
        return
    signatures = [candidate.homotopy for candidate in guide.candidates]
    yield "best path of each homotopy class (L, R: each radar is on its left or right):"
    for path in paths[:_MAX_CLASSES]:
        yield (
            f"  {path.homotopy}  survival {math.exp(-path.risk):.4f}, risk {path.risk:.4f}, "
            f"step {len(path.velocities)} ({counted(signatures.count(path.homotopy), 'solve')})"
        )
    if len(paths) > _MAX_CLASSES:
        yield f"  and {len(paths) - _MAX_CLASSES} more in candidates.csv"


def _certificate(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[str]:
    """The gap to the bound and what it consists of, or what a user's hazard lacks for a bound."""
    certificate, start = guide.certificate, scenario.guide_start
    if certificate is None or guide.gap is None:
        if scenario.hazard.single_agent_lower_bound(start, start) is None:
            yield (
                "not certified: the bound needs a lower bound of your rates over boxes, "
                "lower_bound (see the documentation on custom hazard rates)"
            )
        return
    gap = f"gap {100 * guide.gap:.2g} % of the risk"
    proof = certificate.accelerated or certificate
    remaining = "a better path not found" if guide.search == "global" else "the local search"
    without = (
        f"{100 * certificate.gap:.2g} % without acceleration limits, survival "
        f"{certificate.survival:.4f}"
    )
    if certificate.accelerated is not None:
        gap += f", of paths within a_max that end as deep in the target ({without})"
        if proof.gap < 0.5 * guide.gap:
            gap += f"; remaining gap: {remaining}"
    elif certificate.gap < 0.5 * guide.gap:
        gap += (
            f" ({without}); remaining gap: acceleration, margin and arrival constraints, "
            f"or {remaining}"
        )
    yield gap
    if proof.gap > 0.01:
        yield f"the bound is not within 1 %: {proof.reason}"


@dataclass(frozen=True)
class PlanOptions(GuideOptions):
    """Which guide is planned."""

    acceleration_limited: bool | None = option(
        "--acceleration-limited/--no-acceleration-limited",
        default=None,
        help="Limit the guide's acceleration to a_max. [default: set by the scenario]",
    )


@dataclass(frozen=True)
class SolveOptions:
    """What solves the problem, and how the lower bound on the risk is computed."""

    solver: str = option(
        "--solver",
        default="ipopt",
        shell_complete=completion.solvers,
        help="Solver of the guide problem; casswarm solvers lists them. With projected-gradient "
        "the paper's penalised form is solved.",
    )
    certify: bool = option(
        "--certify/--no-certify",
        default=True,
        show_default=False,  # said in the help, by the flag's name
        help="Compute a lower bound on the risk of any guide. [default: certify]",
    )
    gap: float = option(
        "--gap",
        type=Number(0.0, 1.0, min_open=True, max_open=True),
        default=0.01,
        help="Stop tightening the bound at this relative gap to the best known risk.",
    )
    time_limit: float | None = option(
        "--time-limit",
        type=Number(0.0, min_open=True, infinite=True),
        help="Time limit for planning as a whole, in seconds: a search that takes longer ends with "
        "the best guide so far, and the bound takes what is left; --map may take as long again. "
        "[default: none for the search and the map, 10 for the bound]",
    )
    with_map: bool = option("--map", is_flag=True, help="Also plot the cost-to-go map.")


@click.command()
@options
def plan(
    common: CommonOptions, planning: PlanOptions, solving: SolveOptions, output: VerboseOptions
) -> None:
    """Plan the guide of a scenario.

    The guide is the path of least risk for a single agent, which the swarm follows. Writes
    guide.csv (a row per step), candidates.csv (the outcome of every initial guess), paths.csv (the
    best path of every homotopy class), guide.png and run.json; casswarm plot draws the figures
    again. The paper's projected gradient is compared with a global search in comparison.csv and
    comparison.png.

    \b
    Examples:
      casswarm plan paper-1
      casswarm plan paper-1 --search global --arrival any --gap 0.0001
      casswarm plan paper-1 --solver projected-gradient
      casswarm plan single-agent --map
      casswarm plan single-agent --verbose
      casswarm plan my-scenario.toml --set guide.a_max=0.3 --json
    """
    if not solving.certify:
        refuse("no bound is computed with --no-certify", "gap")
    reference = solving.solver == "projected-gradient"
    if reference and any(value is not None for value in planning.values.values()):
        raise WrongInput(
            "the paper's projected gradient starts from the straight line, arrives at the last "
            "step and ignores a_max: --search, --arrival and --acceleration-limited do not apply"
        )
    with reported_errors(), progress_report(common.quiet) as progress:
        chosen = load(common, planning.values)
        folder = open_folder("plan", chosen, common.out, common)
        if solving.with_map:
            _require_possible_map(chosen)
        show_log(output.verbose)
        speaks = output.verbose and solving.solver == "ipopt"
        with shown_solvers(output.verbose):
            guide = csw.plan(
                chosen,
                solving.solver,
                certify=solving.certify,
                gap=solving.gap,
                time_limit=solving.time_limit,
                solver_options={"print_level": 5} if speaks else None,
                progress=progress,
            )
        _write_guide(folder, guide, solving.solver)
        ending, baseline, costs = Ending(folder, common, progress), None, None
        if reference:
            search = partial(csw.plan_baseline, chosen, guide, time_limit=solving.time_limit)
            baseline = ending.attempt("the global search for comparison", search)
        if solving.with_map:
            build = partial(csw.CostToGoMap.from_scenario, chosen, [guide.positions])
            costs = ending.attempt("the map", partial(build, time_limit=solving.time_limit))
        objects = partial(_write_objects, folder, guide, baseline, costs)
        ending.attempt("writing what the figures need", objects)
        ending.draw()
        ending.finish(plan_text(chosen, guide, baseline))


def _require_possible_map(scenario: csw.Scenario) -> None:
    """Raise a PlanningError, before the work, if the map would need too many nodes."""
    from ..grid import value_grid

    value_grid(scenario)


def _write_objects(
    folder: ResultsFolder,
    guide: csw.Guide,
    baseline: csw.Guide | None,
    costs: csw.CostToGoMap | None,
) -> None:
    """Write what the figures need beyond the guide: baselines and the cost-to-go map."""
    from ..studies import tables

    paths = guide.best_paths()
    guides = {} if baseline is None else {"projected gradient": guide, "global search": baseline}
    if guides:
        compared = {name: compared.positions for name, compared in guides.items()}
        folder.write_table("paths", tables.path_table({"path": paths, "baseline": compared}))
        folder.write_table("comparison", tables.guide_comparison_table(guides))
    others = list(paths.values())
    folder.write_objects(guide=guide, others=others, baselines=guides, costs=costs)


def _write_guide(folder: ResultsFolder, guide: csw.Guide, solver: str) -> None:
    """Write the guide: tables, objects and record."""
    from ..studies import tables

    folder.write_table("guide", tables.guide_table(guide))
    folder.write_table("candidates", tables.candidate_table(guide))
    paths = guide.best_paths()
    folder.write_table("paths", tables.path_table({"path": paths}))
    folder.write_objects(guide=guide, others=list(paths.values()))
    folder.write_record(guide.as_dict(), {"solver": solver})

"""casswarm plan and casswarm plan-swarm."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import nullcontext, redirect_stdout
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import click

import casswarm as csw

from .._util.text import aligned_table, counted
from .common import Work, WrongInput, load, work
from .options import (
    AmbiguityText,
    CommonOptions,
    GuideOptions,
    Number,
    VerboseOptions,
    option,
    options,
    refuse,
    seed_option,
    solver_option,
)
from .output import show_log

if TYPE_CHECKING:
    from ..guide.passes import Pass
    from ..results.folder import ResultsFolder


_MAX_CLASSES = 6  # that are printed; candidates.csv has them all
_MOST_PARTS = 20  # of a step, that are recommended


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
    lines += _passed_radar(scenario, guide)
    return "\n".join(lines)


def _passed_radar(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[str]:
    """A warning if steps are so long that risk within them counts."""
    from ..guide import coarsest_pass

    found = coarsest_pass(scenario, guide.positions)
    if found is not None:
        part = "step" if scenario.time.substeps == 1 else "part of a step"
        yield (
            f"warning: step {found.step} passes radar {found.radar} at a distance of "
            f"{found.distance:.3g} in a {part} of length {found.length:.3g}, and rates count at "
            f"its end only: time.substeps = {_needed_parts(scenario, found)} counts the way, too"
        )


def _needed_parts(scenario: csw.Scenario, found: Pass) -> int:
    """Number of parts of a step of which none is longer than half the distance."""
    parts = 2 * scenario.time.substeps * found.length / max(found.distance, 1e-300)
    return math.ceil(min(parts, _MOST_PARTS))


def _limits(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[str]:
    """Limits of the search for the guide, and the options that lift them."""
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
        if scenario.hazard.after(1).single_agent_lower_bound(start, start) is None:
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
    if scenario.time.substeps > 1:
        yield "the bound ignores a_max, and lets paths turn and arrive after every part of a step"
    if proof.gap > 0.01:
        yield f"the bound is not within 1 %: {proof.reason}"


@dataclass(frozen=True)
class PlanOptions(GuideOptions):
    """Options of the guide to plan."""

    acceleration_limited: bool | None = option(
        "Limit the guide's acceleration to a_max. [default: set by the scenario]",
        "--acceleration-limited/--no-acceleration-limited",
        default=None,
    )


def ambiguity_option(what: str) -> Any:
    """Option that asks for a mixture of guides or plans."""
    return option(
        f"Plan a mixture of {what} for a hazard that is not known (hazard.case): for the mean of "
        "the prior, the worst prior, the mean over the worst fraction of cases (cvar:0.3), or the "
        "worst prior within a distance (tv:0.5).",
        type=AmbiguityText(),
        metavar="mean|worst|cvar:A|tv:R",
    )


@dataclass(frozen=True)
class SolveOptions:
    """Options of the solver, and of the lower bound on the risk."""

    solver: str = solver_option(
        "Solver of the guide problem; casswarm solvers lists them. With projected-gradient the "
        "paper's penalised form is solved.",
        default="ipopt",
    )
    certify: bool = option(
        "Compute a lower bound on the risk of any guide. [default: certify]",
        "--certify/--no-certify",
        default=True,
        show_default=False,  # said in the help, by the flag's name
    )
    gap: float = option(
        "Stop tightening the bound at this relative gap to the best known risk.",
        type=Number(0.0, 1.0, min_open=True, max_open=True),
        default=0.01,
    )
    time_limit: float | None = option(
        "Time limit for planning as a whole, in seconds: a search that takes longer ends with the "
        "best guide so far, and the bound takes what is left; --map may take as long again. "
        "[default: none for the search and the map, 10 for the bound]",
        type=Number(0.0, min_open=True, infinite=True),
    )
    with_map: bool = option("Also plot the cost-to-go map.", "--map")
    ambiguity: Any = ambiguity_option("guides")
    objective: Literal["survival", "risk"] = option(
        "With cases of the hazard: plan for the mean survival over them, or for the mean risk, as "
        "much of the literature does; without --ambiguity, for the prior mean of the risks.",
        default="survival",
    )


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
    comparison.png. With --ambiguity it writes mixture.csv (a row per path, with its survival in
    every case), paths.csv, mixture.png and run.json.

    \b
    Examples:
      casswarm plan paper-1
      casswarm plan paper-1 --search global --arrival any --gap 0.0001
      casswarm plan paper-1 --solver projected-gradient
      casswarm plan single-agent --map
      casswarm plan single-agent --verbose
      casswarm plan two-gaps --ambiguity worst
      casswarm plan two-gaps --ambiguity worst --objective risk
      casswarm plan my-scenario.toml --set guide.a_max=0.3 --json
    """
    if not solving.certify:
        refuse("no bound is computed with --no-certify", "gap")
    if solving.ambiguity is not None:
        refuse("--ambiguity plans a mixture of guides", "with_map", "solver", "verbose")
    reference = solving.solver == "projected-gradient"
    if reference and any(value is not None for value in planning.values.values()):
        raise WrongInput(
            "the paper's projected gradient starts from the straight line, arrives at the last "
            "step and ignores a_max: --search, --arrival and --acceleration-limited do not apply"
        )
    with work(common) as job:
        chosen = load(common, planning.values)
        if len(chosen.cases) > 1 and solving.ambiguity is None and solving.objective == "survival":
            raise WrongInput(
                f"{chosen.name} has {len(chosen.cases)} cases of its hazard: say with --ambiguity "
                "for which priors the guides shall be good, such as --ambiguity mean, or plan one "
                "for the prior mean of the risks with --objective risk"
            )
        if solving.ambiguity is not None:
            _plan_mixture(job, chosen, solving.ambiguity, solving)
            return
        folder = job.open("plan", chosen)
        chosen = chosen.believed  # of several cases, the mean of their rates
        if solving.with_map:
            from ..grid import value_grid

            value_grid(chosen)  # raises, before the work, if the map would need too many nodes
        show_log(output.verbose)
        speaks = output.verbose and solving.solver == "ipopt"
        with redirect_stdout(sys.stderr) if output.verbose else nullcontext():
            guide = csw.plan(
                chosen,
                solving.solver,
                objective=solving.objective,
                certify=solving.certify,
                gap=solving.gap,
                time_limit=solving.time_limit,
                solver_options={"print_level": 5} if speaks else None,
                progress=job.progress,
            )
        _write_guide(folder, guide, solving.solver)
        baseline, costs = None, None
        if reference:
            search = partial(csw.plan_baseline, chosen, guide, time_limit=solving.time_limit)
            baseline = job.attempt("the global search for comparison", search)
        if solving.with_map:
            build = partial(csw.CostToGoMap.from_scenario, chosen, [guide.positions])
            costs = job.attempt("the map", partial(build, time_limit=solving.time_limit))
        objects = partial(_write_objects, folder, guide, baseline, costs)
        job.attempt("writing what the figures need", objects)
        job.draw()
        if guide.failed:
            job.failures.append("no solve succeeded")
        job.finish(plan_text(chosen, guide, baseline))


def _plan_mixture(job: Work, scenario: csw.Scenario, chosen: Any, solving: SolveOptions) -> None:
    """Plan a mixture of guides, and write it."""
    from ..studies import tables

    folder = job.open("plan", scenario)
    limits: dict[str, Any] = {"gap": solving.gap, "time_limit": solving.time_limit}
    limits |= {"certify": solving.certify, "progress": job.progress}
    mixed = csw.plan(scenario, ambiguity=chosen, objective=solving.objective, **limits)
    paths = {f"path {k}": path.positions for k, path in enumerate(mixed.paths)}
    folder.write_tables(
        mixture=tables.mixture_table(mixed), paths=tables.path_table({"mixture": paths})
    )
    _finish_mixture(job, scenario, mixed, {"ambiguity": chosen, "objective": solving.objective})


def _write_guide(folder: ResultsFolder, guide: csw.Guide, solver: str) -> None:
    """Write the guide: tables, objects and record."""
    from ..studies import tables

    paths = guide.best_paths()
    folder.write_tables(
        guide=tables.guide_table(guide),
        candidates=tables.candidate_table(guide),
        paths=tables.path_table({"path": paths}),
    )
    folder.write_objects(guide=guide, others=list(paths.values()))
    folder.write_record(guide.as_dict(), {"solver": solver})


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
        compared = {name: each.positions for name, each in guides.items()}
        folder.write_tables(
            paths=tables.path_table({"path": paths, "baseline": compared}),
            comparison=tables.guide_comparison_table(guides),
        )
    others = list(paths.values())
    folder.write_objects(guide=guide, others=others, baselines=guides, costs=costs)


_RUNS = 2000  # that estimate the success of a swarm too large for an exact distribution


@dataclass(frozen=True)
class SwarmPlanOptions:
    """Options of planning the swarm."""

    objective: Literal["success", "arrivals", "survivors"] = option(
        "Maximise the probability that at least one member arrives, the mean number of arrivals, "
        "or the mean number of survivors.",
        default="success",
    )
    solver: str = solver_option("Solver.", default="auto")
    seed: int = seed_option()
    min_distance: float | None = option(
        "Minimum distance between any two members.", type=Number(0.0, min_open=True)
    )
    time_limit: float | None = option(
        "Start no further initial guess after this time, in seconds. [default: none]",
        type=Number(0.0, min_open=True, infinite=True),
    )
    ambiguity: Any = ambiguity_option("plans")


@click.command("plan-swarm")
@options
def plan_swarm(common: CommonOptions, planning: SwarmPlanOptions) -> None:
    """Plan the paths of all members jointly.

    Finds the open-loop plan of greatest success. Prints the plan's success probability and a bound
    that no policy can exceed. Writes joint.csv (a row per step and member), outcomes.csv (the
    outcome of every initial guess), joint.png and run.json; casswarm plot draws the figure again.
    If the hazard is not known (hazard.case), the plan is for the prior; with --ambiguity a mixture
    of plans is written instead: mixture.csv, joint.csv, mixture.png and run.json.

    \b
    Examples:
      casswarm plan-swarm paper-1
      casswarm plan-swarm paper-2 --min-distance 0.1
      casswarm plan-swarm paper-1 --objective survivors --time-limit 60
      casswarm plan-swarm two-gaps --ambiguity worst
    """
    if planning.ambiguity is not None:
        refuse("a mixture of plans is for success", "objective")
    with work(common) as job:
        chosen = load(common)
        from ..policies import JointPolicy
        from ..studies.tables import joint_table, outcome_table

        folder = job.open("plan-swarm", chosen)
        # for the initial velocities
        guide = csw.plan(chosen.believed, certify=False, progress=job.progress)
        shared: dict[str, Any] = {"guide": guide, "progress": job.progress}
        asked = asdict(planning)
        if (ambiguity := asked.pop("ambiguity")) is not None:
            del asked["objective"]
            mixed = csw.plan_swarm_mixture(chosen, ambiguity, **asked, **shared)
            _write_mixed_plan(job, chosen, mixed, asked | {"ambiguity": ambiguity})
            return
        found = csw.plan_swarm(chosen, **asked, **shared)
        folder.write_tables(joint=joint_table(found), outcomes=outcome_table(found))
        sampled = None
        if found.distribution is None:
            job.say(f"simulating: {_RUNS} runs")
            policy = JointPolicy.from_plan(found)
            estimated = partial(csw.estimate, chosen, policy, _RUNS, planning.seed)
            sampled = job.attempt("the estimate", partial(estimated, tolerance=1e-4, guide=guide))
        _write_swarm(folder, found, sampled, asdict(planning))
        job.draw()
        job.finish(_swarm_text(chosen, found, sampled))


def _write_mixed_plan(
    job: Work, scenario: csw.Scenario, mixed: csw.MixedPlan, inputs: dict[str, Any]
) -> None:
    from ..studies import tables

    joint = [tables.joint_table(plan).assign(plan=k) for k, plan in enumerate(mixed.plans)]
    job.folder.write_tables(mixture=tables.mixture_table(mixed), joint=tables.stacked(joint))
    _finish_mixture(job, scenario, mixed, inputs)


def _finish_mixture(job: Work, scenario: csw.Scenario, mixed: Any, inputs: dict[str, Any]) -> None:
    """Write the object and the record of a mixture of guides or plans, and print it."""
    job.folder.write_objects(mixed=mixed)
    job.folder.write_record(mixed.as_dict(), inputs)
    job.draw()
    job.finish(f"{scenario.name}: {counted(len(scenario.cases), 'case')} of the hazard\n{mixed}")


def _write_swarm(
    folder: ResultsFolder,
    plan: csw.SwarmPlan,
    sampled: csw.Estimate | None,
    inputs: dict[str, Any],
) -> None:
    from ..studies.tables import estimate_table

    distribution = plan.distribution
    if distribution is not None:
        success = f"{1 - distribution.failure:.6g}"
    elif sampled is None:
        success = "not estimated"
    else:
        success = "{:.4f} to {:.4f} ({:.0%})".format(*sampled.success, sampled.level)
    bound = str(plan.bound) if plan.bound is not None and plan.bound.certified else ""
    survival = getattr(distribution, "survival", None)
    folder.write_objects(positions=plan.positions, survival=survival, success=success, bound=bound)
    result: dict[str, Any] = {
        "objective": plan.objective,
        "value": plan.value,
        "success": plan.success,
        **{
            name: getattr(distribution, name, None)
            for name in ("failure", "arrivals_mean", "survivors_mean")
        },
        "estimate": None if sampled is None else estimate_table([sampled]).to_dict("records")[0],
        "success_bound": None if plan.bound is None else plan.bound.as_dict(),
        "arrivals": plan.arrivals,
        "least_distance": plan.least_distance,
        "solution": plan.solution.as_row(),
        "outcomes": [outcome.as_row() for outcome in plan.outcomes],
        **{
            name: getattr(plan, name)
            for name in ("positions", "velocities", "initial_velocities", "seconds")
        },
    }
    folder.write_record(result, inputs)


def _swarm_text(scenario: csw.Scenario, plan: csw.SwarmPlan, sampled: csw.Estimate | None) -> str:
    lines = [
        f"{scenario.name}: {counted(scenario.n, 'member')}, {counted(scenario.n_steps, 'step')} of "
        f"{scenario.time.dt:g}",
        str(plan),
    ]
    if plan.success is not None and plan.distribution is not None:
        low, high = plan.success
        lines.append(
            f"exact success probability from {low:.12f} to {high:.12f}; on average "
            f"{plan.distribution.survivors_mean:.3f} members alive and "
            f"{plan.distribution.arrivals_mean:.3f} in the target at the end of a run"
        )
    if sampled is not None:
        lines.append(str(sampled))
    if scenario.n > 1:
        lines.append(f"minimum distance between two members: {plan.least_distance:.4g}")
    guesses = [
        {
            "initial guess": outcome.start,
            plan.objective: f"{outcome.value:.6f}" if outcome.separated else "-",
            "status": str(outcome.solution.status) if outcome.separated else "members too close",
            "iterations": f"{outcome.solution.iterations}",
            "violation": f"{outcome.solution.residuals.violation:.1e}",
            "seconds": f"{outcome.seconds:.2f}",
        }
        for outcome in plan.outcomes
    ]
    alive = None if plan.distribution is None else plan.distribution.survival[-1]
    members = [
        {
            "member": f"{member}",
            "arrival step": f"{step}" if step else "never",
            "alive at the end": "-" if alive is None else f"{alive[member]:.4f}",
        }
        for member, step in enumerate(plan.arrivals)
    ]
    lines += [f"{plan.solution}", "", aligned_table(guesses), "", aligned_table(members)]
    return "\n".join(lines)

"""casswarm plan-swarm."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .._util.text import counted
from . import completion
from .common import load, reported_errors
from .ending import Ending
from .options import CommonOptions, Number, option, options, seed_option
from .output import aligned_table, open_folder, progress_report, say

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder

_RUNS = 2000  # that estimate the success of a swarm too large for an exact distribution


@dataclass(frozen=True)
class SwarmPlanOptions:
    """How the swarm is planned."""

    objective: str = option(
        "--objective",
        type=click.Choice(["success", "arrivals", "survivors"]),
        default="success",
        help="Maximise the probability that at least one member arrives, the mean number of "
        "arrivals, or the mean number of survivors.",
    )
    solver: str = option(
        "--solver", default="auto", shell_complete=completion.solvers, help="Solver."
    )
    seed: int = seed_option()
    min_distance: float | None = option(
        "--min-distance",
        type=Number(0.0, min_open=True),
        help="Minimum distance between any two members.",
    )
    time_limit: float | None = option(
        "--time-limit",
        type=Number(0.0, min_open=True, infinite=True),
        help="Start no further initial guess after this time, in seconds. [default: none]",
    )


@click.command("plan-swarm")
@options
def plan_swarm(common: CommonOptions, planning: SwarmPlanOptions) -> None:
    """Plan the paths of all members jointly.

    Finds the open-loop plan of greatest success. Prints the plan's success probability and a bound
    that no policy can exceed. Writes joint.csv (a row per step and member), outcomes.csv (the
    outcome of every initial guess), joint.png and run.json; casswarm plot draws the figure again.

    \b
    Examples:
      casswarm plan-swarm paper-1
      casswarm plan-swarm paper-2 --min-distance 0.1
      casswarm plan-swarm paper-1 --objective survivors --time-limit 60
    """
    with reported_errors(), progress_report(common.quiet) as progress:
        chosen = load(common)
        from ..policies import JointPolicy

        folder = open_folder("plan-swarm", chosen, common.out, common)
        guide = csw.plan(chosen, certify=False, progress=progress)  # for the initial velocities
        swarm_plan = csw.plan_swarm(chosen, **asdict(planning), guide=guide, progress=progress)
        _write_tables(folder, swarm_plan)
        ending, sampled = Ending(folder, common, progress), None
        if swarm_plan.distribution is None:
            say(f"simulating: {_RUNS} runs", common.quiet)
            policy = JointPolicy.from_plan(swarm_plan)
            estimated = partial(csw.estimate, chosen, policy, _RUNS, planning.seed)
            sampled = ending.attempt(
                "the estimate", partial(estimated, tolerance=1e-4, guide=guide)
            )
        _write_record(folder, swarm_plan, sampled, asdict(planning))
        ending.draw()
        ending.finish(_text(chosen, swarm_plan, sampled))


def _write_tables(folder: ResultsFolder, plan: csw.SwarmPlan) -> None:
    from ..studies.tables import joint_table, outcome_table

    folder.write_table("joint", joint_table(plan))
    folder.write_table("outcomes", outcome_table(plan))


def _write_record(
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
    survival = None if distribution is None else distribution.survival
    folder.write_objects(positions=plan.positions, survival=survival, success=success, bound=bound)
    result: dict[str, Any] = {
        "objective": plan.objective,
        "value": plan.value,
        "success": plan.success,
        "failure": None if distribution is None else distribution.failure,
        "arrivals_mean": None if distribution is None else distribution.arrivals_mean,
        "survivors_mean": None if distribution is None else distribution.survivors_mean,
        "estimate": None if sampled is None else estimate_table([sampled]).to_dict("records")[0],
        "success_bound": None if plan.bound is None else plan.bound.as_dict(),
        "arrivals": plan.arrivals,
        "least_distance": plan.least_distance,
        "solution": plan.solution.as_row(),
        "outcomes": [outcome.as_row() for outcome in plan.outcomes],
        "positions": plan.positions,
        "velocities": plan.velocities,
        "initial_velocities": plan.initial_velocities,
        "seconds": plan.seconds,
    }
    folder.write_record(result, inputs)


def _text(scenario: csw.Scenario, plan: csw.SwarmPlan, sampled: csw.Estimate | None) -> str:
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
            plan.objective: f"{outcome.value:.6f}",
            "status": str(outcome.solution.status),
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

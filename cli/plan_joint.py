"""casswarm plan --joint: what the command does for the ways of all members."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from .output import Folder, aligned, json_text, say

if TYPE_CHECKING:
    from ..chain.stratified import Estimate
    from ..planning.joint import SwarmPlan
    from ..scenario import Scenario

_RUNS = 2000  # that estimate the success of a swarm too large for an exact law


def plan_joint(
    scenario: Scenario,
    folder: Folder,
    *,
    objective: str,
    solver: str,
    seed: int,
    min_distance: float | None,
    time_limit: float | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Plan all members at once, write the tables, the figure and the record, and print."""
    from ..planning.joint import plan_swarm
    from ..planning.plan import plan
    from ..policies import JointPolicy
    from ..studies.evaluation import estimate

    say("planning: guide, for V(-1)", quiet)
    guide = plan(scenario, certify=False)
    found = plan_swarm(
        scenario,
        objective,
        solver,
        seed=seed,
        min_distance=min_distance,
        time_limit=time_limit,
        guide=guide,
        progress=lambda start: say(f"planning: {start}", quiet),
    )
    sampled = None
    if found.law is None:
        say(f"evaluating: {_RUNS} runs", quiet)
        sampled = estimate(scenario, JointPolicy.of(found), _RUNS, seed, guide=guide)
    inputs = {
        "objective": objective,
        "solver": solver,
        "seed": seed,
        "min_distance": min_distance,
        "time_limit": time_limit,
    }
    content = _write(folder, scenario, found, sampled, inputs)
    click.echo(json_text(content) if as_json else _words(scenario, found, sampled))
    say(folder.closing(), quiet)


def _write(
    folder: Folder,
    scenario: Scenario,
    found: SwarmPlan,
    sampled: Estimate | None,
    inputs: dict[str, Any],
) -> dict[str, Any]:
    from ..results.catalogue import swarm_plan_figures
    from ..studies.tables import estimate_table, joint_table, outcome_table

    folder.table("joint", joint_table(found))
    folder.table("outcomes", outcome_table(found))
    told = _told(found, sampled)
    survival = None if found.law is None else found.law.survival
    folder.draw(swarm_plan_figures(scenario, found.positions, survival, *told))
    result: dict[str, Any] = {
        "objective": found.objective,
        "value": found.value,
        "success": found.success,
        "failure": None if found.law is None else found.law.failure,
        "arrivals_mean": None if found.law is None else found.law.arrivals_mean,
        "survivors_mean": None if found.law is None else found.law.survivors_mean,
        "estimate": None if sampled is None else estimate_table([sampled]).to_dict("records")[0],
        "success_bound": None if found.bound is None else found.bound.as_dict(),
        "arrivals": found.arrivals,
        "least_distance": found.least_distance,
        "solution": found.solution.as_row(),
        "outcomes": [outcome.as_row() for outcome in found.outcomes],
        "positions": found.positions,
        "velocities": found.velocities,
        "before": found.before,
        "seconds": found.seconds,
        "told": told,
    }
    return folder.record(result, inputs)


def _told(found: SwarmPlan, sampled: Estimate | None) -> tuple[str, str]:
    """Success, and what no policy can exceed, as the figure's title says them."""
    if sampled is not None:
        low, high = sampled.success
        success = f"{low:.4f} to {high:.4f} ({sampled.level:.0%})"
    else:
        assert found.law is not None
        success = f"{1 - found.law.failure:.6g}"
    certified = found.bound is not None and found.bound.certified
    return success, str(found.bound) if certified else ""


def _words(scenario: Scenario, found: SwarmPlan, sampled: Estimate | None) -> str:
    lines = [
        f"{scenario.name}: {scenario.n} members, {scenario.n_steps} steps of {scenario.time.dt:g}",
        str(found),
    ]
    if found.success is not None and found.law is not None:
        low, high = found.success
        lines.append(
            f"exact, from {low:.12f} to {high:.12f}; {found.law.survivors_mean:.3f} alive and "
            f"{found.law.arrivals_mean:.3f} in the target when the run ends, in the mean"
        )
    if sampled is not None:
        lines.append(str(sampled))
    if scenario.n > 1:
        lines.append(f"least distance of two members: {found.least_distance:.4g}")
    lines += [f"{found.solution}", "", _starts(found), "", _members(found)]
    return "\n".join(lines)


def _starts(found: SwarmPlan) -> str:
    head = ("start", found.objective, "status", "iterations", "violation", "seconds")
    rows = [
        (
            outcome.origin,
            f"{outcome.value:.6f}",
            str(outcome.solution.status),
            f"{outcome.solution.iterations}",
            f"{outcome.solution.residuals.violation:.1e}",
            f"{outcome.seconds:.2f}",
        )
        for outcome in found.outcomes
    ]
    return aligned([head, *rows])


def _members(found: SwarmPlan) -> str:
    alive = None if found.law is None else found.law.survival[-1]
    head = ("member", "arrival step", "alive at the end")
    rows = [
        (
            f"{member + 1}",
            f"{step}" if step else "never",
            "-" if alive is None else f"{alive[member]:.4f}",
        )
        for member, step in enumerate(found.arrivals)
    ]
    return aligned([head, *rows])

"""casswarm evaluate."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import load, named_policies, reported_errors
from .options import (
    distribution_options,
    figure_options,
    policy_option,
    scenario_options,
    seed_option,
    solver_option,
)
from .output import Folder, aligned, json_text, say

if TYPE_CHECKING:
    from ..chain.distribution import OutcomeDistribution
    from ..chain.stratified import Estimate
    from ..planning.bounds.success_bound import SuccessBound
    from ..scenario import Scenario


@click.command()
@scenario_options
@figure_options
@policy_option
@distribution_options
@click.option(
    "--runs",
    type=click.IntRange(1),
    help="Sample by so many runs what the states leave: an interval inside the bracket, with "
    "95 % confidence. For large swarms.",
)
@seed_option
@solver_option
def evaluate(
    scenario: str,
    settings: tuple[str, ...],
    out: Path | None,
    figures: str,
    as_json: bool,
    quiet: bool,
    width: str,
    dpi: int,
    policies: tuple[str, ...],
    tolerance: float,
    max_states: int | None,
    aggregation_tol: float,
    runs: int | None,
    seed: int,
    solver: str,
) -> None:
    """Compute how often the swarm reaches the target, exactly: brackets, no sampling.

    Prints a table and writes laws.csv, arrival.csv (probability of the first arrival at every
    step), survivors.csv, members.csv (survival of every member), population.csv (how many are
    alive at every step), run.json and the figures success, arrival, population and survival, which
    casswarm plot draws again.

    \b
    Examples:
      casswarm evaluate paper-1
      casswarm evaluate paper-2 --policy leader --tolerance 1e-4
      casswarm evaluate paper-1 --tolerance 1e-6 --aggregation-tol 1e-6
      casswarm evaluate large-swarm --policy leader --runs 2000
    """
    with reported_errors():
        chosen = load(scenario, settings)
        from ..planning.bounds.success_bound import success_bound
        from ..planning.plan import plan
        from ..studies.evaluation import estimate
        from ..studies.evaluation import evaluate as exact_law

        folder = Folder("evaluate", chosen, out, figures, width=width, dpi=dpi)
        guide = plan(chosen, certify=False, progress=lambda start: say(f"planning: {start}", quiet))
        laws, estimates = [], []
        for policy in named_policies(policies):
            say(f"evaluating {getattr(policy, 'name', policy)}", quiet)
            options: dict[str, Any] = {
                "max_states": max_states,
                "aggregation_tol": aggregation_tol,
                "guide": guide,
                "solver": solver,
                "progress": None if quiet else _tell,
            }
            if runs is None:
                laws.append(exact_law(chosen, policy, tolerance, **options))
            else:
                estimates.append(
                    estimate(chosen, policy, runs, seed, tolerance=tolerance, **options)
                )
                laws.append(estimates[-1].enumerated)
    inputs = {
        "tolerance": tolerance,
        "max_states": max_states,
        "aggregation_tol": aggregation_tol,
        "runs": runs,
        "seed": seed,
        "solver": solver,
    }
    bound = success_bound(chosen)
    content = _write(folder, chosen, laws, estimates, bound, inputs)
    words = [_words(chosen, laws)] if not estimates else [str(found) for found in estimates]
    words += ["", str(bound)]
    click.echo(json_text(content) if as_json else "\n".join(words))
    say(folder.closing(), quiet)


def _tell(policy: str, done: float, total: float | None) -> None:  # noqa: ARG001
    """Overwrite the progress line, if standard error is a terminal."""
    if sys.stderr.isatty():
        click.echo(f"\r  {policy}: residual mass {1.0 - done:.2e} \r", err=True, nl=False)


def _write(
    folder: Folder,
    scenario: Scenario,
    laws: list[OutcomeDistribution],
    estimates: list[Estimate],
    bound: SuccessBound,
    inputs: dict[str, Any],
) -> dict[str, Any]:
    from ..results.catalogue import evaluation_figures
    from ..studies.tables import (
        arrival_table,
        estimate_table,
        law_table,
        member_table,
        population_table,
        survivor_table,
    )

    table = successes = law_table(laws)
    result: dict[str, Any] = {"laws": table.to_dict("records"), "success_bound": bound.as_dict()}
    if estimates:
        successes = estimate_table(estimates)
        folder.table("estimates", successes)
        result["estimates"] = successes.to_dict("records")
    folder.table("laws", table)
    folder.table("arrival", arrival_table(laws))
    folder.table("survivors", survivor_table(laws))
    folder.table("members", member_table(laws))
    folder.table("population", population_table(laws))
    folder.draw(evaluation_figures(scenario, laws, successes))
    return folder.record(result, inputs)


def _words(scenario: Scenario, laws: list[OutcomeDistribution]) -> str:
    head = ("policy", "success, bracket", "survivors", "states", "infeasible", "solver failures")
    rows = [
        (
            law.policy,
            f"{law.success[0]:.6f} to {law.success[1]:.6f}",
            f"{law.survivors_mean[0]:.3f} to {law.survivors_mean[1]:.3f}",
            f"{law.states}",
            f"{law.infeasible:.2f}",
            f"{law.failures:.4f}",
        )
        for law in laws
    ]
    notes = [f"{law.policy}: {law.advice}" for law in laws if not law.complete]
    merged = [] if all(law.proven for law in laws) else [_MERGED.format(laws[0].aggregation_tol)]
    table = aligned([head, *rows])
    lines = [f"{scenario.name}, exact law; counts are means of a run", "", table]
    return "\n".join(lines + ([""] if notes or merged else []) + notes + merged)


_MERGED = "states within {:g} of each other were merged: the brackets are those of that chain"

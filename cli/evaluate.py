"""casswarm evaluate."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .common import load, named_policies, reported_errors
from .ending import Ending
from .options import (
    CommonOptions,
    ExactOptions,
    PolicyOptions,
    option,
    options,
    refuse,
    seed_option,
)
from .output import aligned_table, open_folder, progress_report, say

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


@dataclass(frozen=True)
class EstimateOptions:
    """How the rest of a distribution is sampled."""

    runs: int | None = option(
        "--runs",
        type=click.IntRange(1),
        help="Estimate the probability that enumeration leaves from this number of runs: a 95 % "
        "confidence interval within the bounds. For large swarms.",
    )
    seed: int = seed_option()


@click.command()
@options
def evaluate(
    common: CommonOptions,
    policies: PolicyOptions,
    exact: ExactOptions,
    sampling: EstimateOptions,
) -> None:
    """Compute success probabilities exactly.

    Bounds how often the swarm reaches the target from below and above, without sampling. Prints a
    table and writes distributions.csv, arrival.csv (probability of the first arrival at every
    step), survivors.csv, members.csv (survival of every member), population.csv (number alive at
    every step), run.json and the figures success, arrival, population and survival, which casswarm
    plot draws again.

    \b
    Examples:
      casswarm evaluate paper-1
      casswarm evaluate paper-2 --policy leader --tolerance 1e-4
      casswarm evaluate paper-1 --tolerance 1e-6 --aggregation-tol 1e-6
      casswarm evaluate large-swarm --policy leader --runs 2000
    """
    if sampling.runs is None:
        refuse("nothing is sampled without --runs", "seed")
    with reported_errors(), progress_report(common.quiet) as progress:
        chosen = load(common)
        from ..guide.plan import guide_solver

        chosen_policies = named_policies(policies)
        folder = open_folder("evaluate", chosen, common.out, common)
        if not common.no_figures:
            folder.prepare_figures()
        solver = guide_solver(policies.solver)
        guide = csw.plan(chosen, solver, certify=False, progress=progress)
        shared: dict[str, Any] = {**asdict(exact), "guide": guide, "solver": policies.solver}
        shared["progress"] = progress
        distributions, estimates = [], []
        for policy in chosen_policies:
            say(f"evaluating {getattr(policy, 'name', policy)}", common.quiet)
            if sampling.runs is None:
                distributions.append(csw.evaluate(chosen, policy, **shared))
            else:
                estimates.append(
                    csw.estimate(chosen, policy, sampling.runs, sampling.seed, **shared)
                )
                distributions.append(estimates[-1].enumerated)
        result = _write_tables(folder, distributions, estimates)
        ending = Ending(folder, common, progress)
        bound = ending.attempt("the success bound", partial(csw.success_bound, chosen))
        result["success_bound"] = None if bound is None else bound.as_dict()
        inputs = {**asdict(exact), **asdict(sampling), "solver": policies.solver}
        folder.write_record(result, inputs)
        ending.draw()
        text = "\n".join(map(str, estimates)) if estimates else _text(chosen, distributions)
        ending.finish(text if bound is None else f"{text}\n\n{bound}")


def _write_tables(
    folder: ResultsFolder,
    distributions: list[csw.OutcomeDistribution],
    estimates: list[csw.Estimate],
) -> dict[str, Any]:
    """Write the tables and objects; returns the result for the record."""
    from ..studies import tables

    table = tables.distribution_table(distributions)
    result: dict[str, Any] = {"distributions": table.to_dict("records")}
    if estimates:
        estimated = tables.estimate_table(estimates)
        folder.write_table("estimates", estimated)
        result["estimates"] = estimated.to_dict("records")
    folder.write_objects(distributions=distributions)
    folder.write_table("distributions", table)
    folder.write_table("arrival", tables.arrival_table(distributions))
    folder.write_table("survivors", tables.survivor_table(distributions))
    folder.write_table("members", tables.member_table(distributions))
    folder.write_table("population", tables.population_table(distributions))
    return result


def _text(scenario: csw.Scenario, distributions: list[csw.OutcomeDistribution]) -> str:
    from ..studies.tables import count_notes

    rows = [
        {
            "policy": distribution.policy,
            "success, bounds": "{:.6f} to {:.6f}".format(*distribution.success),
            "survivors": "{:.3f} to {:.3f}".format(*distribution.survivors_mean),
            "states": f"{distribution.states}",
        }
        for distribution in distributions
    ]
    counts = [
        {
            "policy": distribution.policy,
            "infeasible": distribution.infeasible,
            "solver_failures": distribution.failures,
        }
        for distribution in distributions
    ]
    notes = count_notes(counts, "per run on average")
    notes += [
        f"{distribution.policy}: {distribution.advice}"
        for distribution in distributions
        if not distribution.complete
    ]
    spacing = max(distribution.aggregation_tol for distribution in distributions)
    if spacing > 0:
        notes.append(
            f"motion is rounded to a lattice of spacing {spacing:.2g}: the bounds are those of the "
            "policies with rounded commands"
        )
    title = f"{scenario.name}: exact outcome distribution"
    return "\n".join([title, "", aligned_table(rows), *notes])

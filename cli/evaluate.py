"""casswarm evaluate."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .._util.text import aligned_table
from .common import WrongInput, load, named_policies, work
from .options import (
    COUNT,
    CommonOptions,
    ExactOptions,
    PolicyOptions,
    option,
    options,
    refuse,
    seed_option,
)

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


@dataclass(frozen=True)
class EstimateOptions:
    """Options of sampling the rest of a distribution."""

    runs: int | None = option(
        "Estimate the probability that enumeration leaves from this number of runs: a 95 % "
        "confidence interval within the bounds. For large swarms.",
        type=COUNT,
    )
    seed: int = seed_option()


@dataclass(frozen=True)
class InformationOptions:
    """Option of comparing what members know."""

    information: bool = option(
        "For a hazard that is not known (hazard.case), also compare members that know its prior, "
        "its posterior given who has survived, and its true case: information.csv and a figure."
    )


@click.command()
@options
def evaluate(
    common: CommonOptions,
    policies: PolicyOptions,
    exact: ExactOptions,
    sampling: EstimateOptions,
    unknown: InformationOptions,
) -> None:
    """Compute success probabilities exactly.

    Bounds how often the swarm reaches the target from below and above, without sampling. Predicts
    the number of states before, and the memory that they take. Prints a table and writes
    distributions.csv, arrival.csv (probability of the first arrival at every step), survivors.csv,
    members.csv (survival of every member), population.csv (number alive at every step), run.json
    and the figures success, arrival, population and survival, which casswarm plot draws again. If
    the hazard is not known (hazard.case), all of them are for the prior, and cases.csv and the
    figure cases also have the success in every case.

    \b
    Examples:
      casswarm evaluate paper-1
      casswarm evaluate paper-2 --policy leader --tolerance 1e-4
      casswarm evaluate paper-1 --tolerance 1e-6 --aggregation-tol 1e-6
      casswarm evaluate paper-2 --policy leader --tolerance 1e-5 --memory 100
      casswarm evaluate large-swarm --policy leader --runs 2000
      casswarm evaluate two-gaps --policy leader --policy joint --information
    """
    if sampling.runs is None:
        refuse("nothing is sampled without --runs", "seed")
    with work(common) as job:
        chosen = load(common)
        if unknown.information and len(chosen.cases) == 1:
            raise WrongInput(f"--information: the hazard of {chosen.name} is known (hazard.case)")
        from ..guide.agent import guide_solver
        from ..studies.evaluation import expansion_options
        from ..studies.inputs import resolve_policy

        # refuses what is not possible, before the work
        expansion_options(chosen, exact.tolerance, exact.max_states, memory=exact.memory)
        chosen_policies = named_policies(policies)
        folder = job.open("evaluate", chosen)
        job.prepare_figures()
        guide = csw.plan(
            chosen.believed, guide_solver(policies.solver), certify=False, progress=job.progress
        )
        inputs: dict[str, Any] = {**asdict(exact), "guide": guide, "solver": policies.solver}
        shared = {**inputs, "progress": job.progress}
        distributions, estimates = [], []
        for each in chosen_policies:
            policy = resolve_policy(each, chosen, guide, policies.solver)  # which may take a plan
            job.say(f"evaluating {policy.name}")
            if sampling.runs is None and not common.quiet:
                job.say(str(csw.predict_states(chosen, policy, **inputs, time_limit=1.0)))
            if sampling.runs is None:
                distributions.append(csw.evaluate(chosen, policy, **shared))
            else:
                estimates.append(
                    csw.estimate(chosen, policy, sampling.runs, sampling.seed, **shared)
                )
                distributions.append(estimates[-1].enumerated)
        result = _write_tables(folder, distributions, estimates)
        texts = ["\n".join(map(str, estimates)) if estimates else _text(chosen, distributions)]
        if unknown.information:
            job.say("comparing what members know")
            del shared["guide"]
            known = csw.value_of_information(chosen, chosen_policies, **shared)
            folder.write_tables(information=known)
            texts.append(aligned_table(_information_texts(known)))
        bound = job.attempt("the success bound", partial(csw.success_bound, chosen))
        result["success_bound"] = None if bound is None else bound.as_dict()
        folder.write_record(
            result, {**asdict(exact), **asdict(sampling), "solver": policies.solver}
        )
        job.draw()
        job.finish("\n\n".join([*texts, *([] if bound is None else [str(bound)])]))


def _information_texts(table: Any) -> list[dict[str, str]]:
    return [
        {
            "policy": str(row["policy"]),
            "members know the": str(row["information"]),
            "success, bounds": f"{row['success_low']:.6f} to {row['success_high']:.6f}",
        }
        for row in table.to_dict("records")
    ]


def _write_tables(
    folder: ResultsFolder,
    distributions: list[csw.OutcomeDistribution],
    estimates: list[csw.Estimate],
) -> dict[str, Any]:
    """Write the tables and objects; returns the result for the record."""
    from ..studies import tables

    table = tables.distribution_table(distributions)
    estimated = {"estimates": tables.estimate_table(estimates)} if estimates else {}
    if distributions[0].cases:
        estimated["cases"] = tables.case_table(estimates or distributions)
    folder.write_tables(**estimated)
    folder.write_objects(distributions=distributions)
    folder.write_tables(
        distributions=table,
        arrival=tables.arrival_table(distributions),
        survivors=tables.survivor_table(distributions),
        members=tables.member_table(distributions),
        population=tables.population_table(distributions),
    )
    return {
        name: each.to_dict("records")
        for name, each in {"distributions": table, **estimated}.items()
    }


def _text(scenario: csw.Scenario, distributions: list[csw.OutcomeDistribution]) -> str:
    from ..studies.tables import by_case, count_notes

    rows = [
        {"policy": each.policy}
        | ({"case": case} if len(scenario.cases) > 1 else {})
        | {
            "success, bounds": "{:.6f} to {:.6f}".format(*each.success),
            "survivors": "{:.3f} to {:.3f}".format(*each.survivors_mean),
            "states": f"{each.states}",
        }
        for case, _, each in by_case(distributions)
    ]
    counts = [
        {"policy": each.policy, "infeasible": each.infeasible, "solver_failures": each.failures}
        for each in distributions
    ]
    notes = count_notes(counts, "per run on average")
    notes += [f"{each.policy}: {each.advice}" for each in distributions if not each.complete]
    spacing = max(each.aggregation_tol for each in distributions)
    if spacing > 0:
        notes.append(
            f"motion is rounded to a lattice of spacing {spacing:.2g}: the bounds are those of the "
            "policies with rounded commands"
        )
    title = f"{scenario.name}: exact outcome distribution"
    return "\n".join([title, "", aligned_table(rows), *notes])

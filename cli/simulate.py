"""casswarm simulate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .._util.text import aligned_table, counted
from .common import Work, WrongInput, executor, load, named_policies, work
from .options import (
    COUNT,
    CommonOptions,
    GuideOptions,
    Number,
    PolicyOptions,
    StudyOptions,
    option,
    options,
    refuse,
    seed_option,
)

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


@dataclass(frozen=True)
class SimulateOptions:
    """Options of the runs to simulate, and of their output."""

    runs: int | None = option("Number of runs per policy. [default: 1000]", type=COUNT)
    half_width: float | None = option(
        "Choose the number of runs for intervals of about this half-width, from a pilot study of "
        "1000 runs.",
        type=Number(0, 0.5, min_open=True, max_open=True),
    )
    seed: int = seed_option()
    save_trajectories: int = option(
        "Number of runs per policy whose trajectories are saved.", type=COUNT, default=5
    )
    report: bool = option("Also write a self-contained report.html.")

    def __post_init__(self) -> None:
        if self.runs is not None and self.half_width is not None:
            raise WrongInput("--runs and --half-width: give one of them")


@click.command()
@options
def simulate(
    common: CommonOptions,
    policies: PolicyOptions,
    sampling: SimulateOptions,
    execution: StudyOptions,
    planning: GuideOptions,
) -> None:
    """Estimate success probabilities by simulation.

    Estimates by Monte Carlo how often the swarm reaches the target under each policy. A run index
    sees the same random numbers under every policy, so differences are paired run by run. Prints
    tables and writes summary.csv, paired.csv, runs.csv (a row per run), trajectories.csv (the saved
    trajectories), guide.csv, run.json and figures: success, differences, and for the first run of
    every policy a map and close-ups of its formation. casswarm plot draws them again, casswarm
    animate animates a saved run. Results are saved incrementally: resume an interrupted study with
    --resume. If the hazard is not known (hazard.case), the true case of every run is drawn by the
    prior; cases.csv and the figure cases have the success in every case.

    \b
    Examples:
      casswarm simulate paper-1
      casswarm simulate paper-1 --report
      casswarm simulate paper-1 --policy leader --runs 5000 --seed 7 --workers 2
      casswarm simulate paper-1 --half-width 0.005 --workers 2
      casswarm simulate my-scenario.toml --set formation.rho=0.1 --policy my_module:my_policy
    """
    if policies.solver == "projected-gradient":
        refuse(
            "projected-gradient starts from the straight line and arrives at the last step",
            "search",
            "arrival",
        )
    if sampling.report and common.no_figures:
        raise WrongInput("--report and --no-figures: give one of them, the report shows figures")
    with work(common) as job:
        chosen = load(common, planning.values)
        from ..guide.agent import guide_solver

        chosen_policies = named_policies(policies)
        folder = job.open("simulate", chosen, execution.saved_since)
        whole = execution.part is None
        if whole:
            job.prepare_figures()
        solver = guide_solver(policies.solver)
        guide = csw.plan(chosen.believed, solver, certify=whole, progress=job.progress)
        shared: dict[str, Any] = {"guide": guide, "solver": policies.solver}
        study = _study(job, chosen, chosen_policies, sampling, execution, shared)
        inputs = {
            "policies": list(study.summary["policy"]),
            "runs": int(study.summary["runs"].iloc[0]),
            "half_width": sampling.half_width,
            "seed": sampling.seed,
            "save_trajectories": sampling.save_trajectories,
            "workers": execution.workers,
            "solver": policies.solver,
        }
        _write_tables(folder, study)
        bound = job.attempt("the success bound", partial(csw.success_bound, chosen))
        folder.write_objects(guide=guide, trajectories=study.trajectories, success_bound=bound)
        proven = {"success_bound": None if bound is None else bound.as_dict()}
        folder.write_record(study.as_dict() | proven, inputs)
        job.draw()
        if sampling.report:
            job.say("writing the report")
            job.report()
        job.finish(_text(study) if bound is None else f"{_text(study)}\n\n{bound}")


def _study(
    job: Work,
    scenario: csw.Scenario,
    policies: list[Any],
    sampling: SimulateOptions,
    execution: StudyOptions,
    shared: dict[str, Any],
) -> csw.Study:
    """Simulate as many runs as the options say, or a pilot study."""
    runs = sampling.runs or 1000
    if sampling.half_width is not None:
        runs = csw.runs_needed(scenario, policies, sampling.half_width, sampling.seed, **shared)
        job.say(f"pilot study: {counted(runs, 'run')} per policy needed")
    with executor(execution) as workers:
        return csw.simulate(
            scenario,
            policies,
            runs,
            sampling.seed,
            workers,
            save_trajectories=sampling.save_trajectories,
            progress=job.progress,
            checkpoint=job.checkpoint(execution.part),
            if_exists=execution.if_exists,
            **shared,
        )


def _write_tables(folder: ResultsFolder, study: csw.Study) -> None:
    from ..studies.tables import guide_table, trajectory_table

    folder.write_tables(
        summary=study.summary,
        **{"paired": study.paired} if len(study.paired) else {},
        **{} if study.cases is None else {"cases": study.cases},
        runs=study.runs,
        guide=guide_table(study.guide),
        trajectories=trajectory_table(study.trajectories),
    )


def _text(study: csw.Study) -> str:
    from ..studies.tables import count_notes, end_notes, paired_texts, summary_texts

    table = study.summary if study.cases is None else study.cases
    lines = [
        f"{study.scenario.name}: {study.guide}",
        "",
        aligned_table(summary_texts(table).to_dict("records")),
        *count_notes(study.summary.to_dict("records")),
        *end_notes(study.runs, study.guide, study.scenario.for_guide.swarm.v_max),
    ]
    if len(study.paired):
        lines += [
            "",
            aligned_table(paired_texts(study.paired).to_dict("records")),
            "A - B, paired run by run; A : B: runs in which only A, only B succeeds;",
            "p: McNemar's test; variance: ratio of paired to independent runs",
        ]
    return "\n".join(lines)

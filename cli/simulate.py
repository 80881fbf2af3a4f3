"""casswarm simulate."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import RESUME, WrongInput, executor, load, named_policies, reported_errors
from .options import figure_options, policy_option, scenario_options, solver_option, study_options
from .output import Folder, aligned, json_text, progress_bar, say

if TYPE_CHECKING:
    import pandas as pd

    from ..planning.bounds.success_bound import SuccessBound
    from ..studies.simulation import Study
    from ..typing import Progress


@click.command()
@scenario_options
@figure_options
@policy_option
@click.option("--runs", type=click.IntRange(1), help="Runs of every policy. [default: 1000]")
@click.option(
    "--half-width",
    type=click.FloatRange(0, 0.5, min_open=True, max_open=True),
    help="Take as many runs as make the intervals about this half-width, by a pilot of 1000.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Same seed, same tables."
)
@click.option(
    "--keep",
    type=click.IntRange(1),
    default=5,
    show_default=True,
    help="First runs of every policy whose way is kept, for casswarm plot and animate.",
)
@click.option(
    "--report", is_flag=True, help="Leave report.html, too: one page with all of it, to be sent."
)
@study_options
@solver_option
@click.option(
    "--search",
    type=click.Choice(["local", "global"]),
    help="How the guide is searched for. [default: the scenario's]",
)
@click.option(
    "--arrival",
    type=click.Choice(["any", "horizon"]),
    help="Choose the guide's best arrival step, or use all the time. [default: the scenario's]",
)
def simulate(
    scenario: str,
    settings: tuple[str, ...],
    out: Path | None,
    figures: str,
    as_json: bool,
    quiet: bool,
    width: str,
    dpi: int,
    policies: tuple[str, ...],
    runs: int | None,
    half_width: float | None,
    seed: int,
    keep: int,
    report: bool,
    workers: int,
    dask: str | None,
    resume: bool,
    fresh: bool,
    solver: str,
    search: str | None,
    arrival: str | None,
) -> None:
    """Estimate how often the swarm reaches the target, policy by policy.

    Every run index sees the same random numbers under every policy, so differences are taken run
    by run. Prints tables and writes summary.csv, paired.csv, runs.csv (a row a run), traces.csv
    (the ways of the first runs), guide.csv, run.json and figures: success, differences, and of the
    first run of every policy a map and close-ups of its formation. casswarm plot draws them again,
    casswarm animate shows them moving. Results are kept as they are made: a run that was stopped
    goes on with --resume.

    \b
    Examples:
      casswarm simulate paper-1
      casswarm simulate paper-1 --report
      casswarm simulate paper-1 --policy leader --runs 5000 --seed 7 --workers 2
      casswarm simulate paper-1 --half-width 0.005 --workers 2
      casswarm simulate my-scenario.toml --set formation.rho=0.1 --policy my_module:my_policy
    """
    with reported_errors(resumes=True), ExitStack() as stack:
        chosen = load(scenario, settings, guide__search=search, guide__arrival=arrival)
        from ..planning.bounds.success_bound import success_bound
        from ..planning.plan import plan
        from ..studies.pilot import runs_needed
        from ..studies.simulation import simulate as sample

        if runs is not None and half_width is not None:
            raise WrongInput("--runs and --half-width: give one of them")
        folder = Folder("simulate", chosen, out, figures, RESUME, width, dpi)
        guide = plan(chosen, progress=lambda start: say(f"planning: {start}", quiet))
        made = named_policies(policies)
        if half_width is not None:
            runs = runs_needed(chosen, made, half_width, seed, guide=guide, solver=solver)
            say(f"{runs} runs of every policy, by a pilot", quiet)
        study = sample(
            chosen,
            made,
            1000 if runs is None else runs,
            seed,
            stack.enter_context(executor(workers, dask)),
            guide=guide,
            solver=solver,
            save_trajectories=keep,
            progress=None if quiet else _bars(stack),
            checkpoint=folder.path,
            if_exists="resume" if resume else "overwrite" if fresh else "error",
        )
    inputs = {
        "policies": list(study.summary["policy"]),
        "runs": int(study.summary["runs"].iloc[0]),
        "half_width": half_width,
        "seed": seed,
        "keep": keep,
        "workers": workers,
        "solver": solver,
    }
    bound = success_bound(chosen)
    content = _write(folder, study, bound, inputs)
    if report:
        _report(folder, quiet)
    click.echo(json_text(content) if as_json else f"{_words(study)}\n\n{bound}")
    say(folder.closing(), quiet)


def _bars(stack: ExitStack) -> Progress:
    """A progress bar a policy."""
    bars: dict[str, Any] = {}

    def tell(policy: str, ended: float, total: float | None) -> None:
        if policy not in bars:
            bars[policy] = progress_bar(stack, policy, "run", int(total or 0))
        bars[policy](int(ended), total)

    return tell


def _write(
    folder: Folder, study: Study, bound: SuccessBound, inputs: dict[str, Any]
) -> dict[str, Any]:
    from ..results.catalogue import simulation_figures
    from ..studies.tables import guide_table, trace_table

    scenario, guide = study.scenario, study.guide
    folder.table("summary", study.summary)
    if len(study.paired):
        folder.table("paired", study.paired)
    folder.table("runs", study.runs)
    folder.table("guide", guide_table(guide))
    folder.table("traces", trace_table(study.trajectories))
    folder.draw(
        simulation_figures(scenario, guide, study.summary, study.paired, study.trajectories)
    )
    result = {
        "summary": study.summary.to_dict("records"),
        "paired": study.paired.to_dict("records"),
        "effort": study.effort.to_dict("records"),
        "guide": {
            "risk": guide.risk,
            "survival": guide.survival,
            "risk_bound": guide.risk_bound,
            "solution": guide.solution.as_row(),
        },
        "success_bound": bound.as_dict(),
    }
    return folder.record(result, inputs)


def _report(folder: Folder, quiet: bool) -> None:
    """The page, made from what is in the folder."""
    from ..results.folder import Saved
    from ..results.simulation_report import simulation_page

    say("report", quiet)
    folder.text("report.html", simulation_page(Saved.of(folder.path)))
    folder.add_to_record()


def _words(study: Study) -> str:
    text = f"{study.scenario.name}: {study.guide}\n\n{summary_text(study.summary)}"
    return f"{text}\n\n{paired_text(study.paired)}" if len(study.paired) else text


def summary_text(summary: pd.DataFrame) -> str:
    """The summary for a terminal: probabilities with their intervals, every failure a count."""
    head = (
        "policy",
        "runs",
        "success",
        "95 % interval",
        "survivors",
        "arrival step",
        "infeasible",
        "solver failures",
        "fallbacks",
        "saturated",
    )
    rows = [
        (
            str(row["policy"]),
            f"{row['runs']}",
            f"{row['success']:.4f}" if row["successes"] else "none",
            f"{row['success_low']:.4f} to {row['success_high']:.4f}",
            f"{row['survivors_mean']:.2f}",
            f"{row['arrival_step_mean']:.1f}" if row["successes"] else "-",
            f"{row['infeasible']}",
            f"{row['solver_failures']}",
            f"{row['fallbacks']}",
            f"{row['saturated']}",
        )
        for row in summary.to_dict("records")
    ]
    return aligned([head, *rows])


def paired_text(paired: pd.DataFrame) -> str:
    """Differences between policies on the same random numbers, for a terminal."""
    head = (
        "difference in success",
        "",
        "95 % interval",
        "discordant runs",
        "p, McNemar",
        "variance",
    )
    rows = [
        (
            f"{row['first']} - {row['second']}",
            f"{row['difference']:+.4f}",
            f"{row['difference_low']:+.4f} to {row['difference_high']:+.4f}",
            f"{row['first_only']} : {row['second_only']}",
            f"{row['p_value']:.2g}",
            f"{row['variance_ratio']:.2f} x" if row["variance_ratio"] >= 0 else "-",
        )
        for row in paired.to_dict("records")
    ]
    return (
        f"{aligned([head, *rows])}\n"
        "by the same random numbers run by run; variance: against independent ones"
    )

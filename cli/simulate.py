"""casswarm simulate."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import load, policy_option, reported_errors, scenario_options
from .output import Folder, aligned, json_text, say

if TYPE_CHECKING:
    import pandas as pd

    from ..study import Progress, Study


@click.command()
@scenario_options
@policy_option
@click.option(
    "--runs", type=click.IntRange(1), default=1000, show_default=True, help="Runs of every policy."
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Same seed, same tables."
)
@click.option(
    "--workers",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Processes that share the runs; changes no number.",
)
@click.option(
    "--solver",
    default="auto",
    show_default=True,
    help="Of the formation problems: auto, spectral, ipopt or projected-gradient.",
)
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
    policies: tuple[str, ...],
    runs: int,
    seed: int,
    workers: int,
    solver: str,
    search: str | None,
    arrival: str | None,
) -> None:
    """Estimate how often the swarm reaches the target, policy by policy.

    Every run index sees the same random numbers under every policy. Prints a table and writes
    summary.csv, runs.csv (a row a run), success.png, a map of the first run of every policy, and
    run.json.

    \b
    Examples:
      casswarm simulate paper-1
      casswarm simulate paper-1 --policy leader --runs 5000 --seed 7 --workers 2
      casswarm simulate my-scenario.toml --set formation.rho=0.1
    """
    with reported_errors(), ExitStack() as stack:
        chosen = load(scenario, settings, guide__search=search, guide__arrival=arrival)
        from ..study import PAPER_POLICIES
        from ..study import simulate as sample

        folder = Folder("simulate", chosen, out, figures)
        progress = None if quiet else _bars(stack)
        study = sample(
            chosen,
            policies or PAPER_POLICIES,
            runs,
            seed,
            workers,
            solver=solver,
            progress=progress,
        )
    inputs = {
        "policies": list(study.summary["policy"]),
        "runs": runs,
        "seed": seed,
        "workers": workers,
        "solver": solver,
    }
    content = _write(folder, study, inputs)
    click.echo(json_text(content) if as_json else _words(study))
    say(folder.closing(), quiet)


def _bars(stack: ExitStack) -> Progress:
    """A progress bar a policy on standard error, nothing where that is no terminal."""
    from tqdm import tqdm

    bars: dict[str, Any] = {}

    def tell(policy: str, ended: int, total: int) -> None:
        if policy not in bars:
            bars[policy] = stack.enter_context(
                tqdm(total=total, desc=policy, unit="run", disable=None)
            )
        bars[policy].update(ended - bars[policy].n)

    return tell


def _write(folder: Folder, study: Study, inputs: dict[str, Any]) -> dict[str, Any]:
    from ..figures import success_chart, swarm_map

    scenario = study.scenario
    folder.table("summary", study.summary)
    folder.table("runs", study.runs)
    folder.figure("success", success_chart(study.summary, scenario.name))
    for policy, traces in study.traces.items():
        title = f"{scenario.name}, {policy}, run 0"
        folder.figure(f"run-{policy}", swarm_map(scenario, traces[0], study.guide, title))
    result = {
        "summary": study.summary.to_dict("records"),
        "effort": study.effort.to_dict("records"),
        "guide": {"risk": study.guide.risk, "survival": study.guide.survival},
    }
    return folder.record(result, inputs)


def _words(study: Study) -> str:
    return f"{study.scenario.name}: {study.guide}\n\n{summary_text(study.summary)}"


def summary_text(summary: pd.DataFrame) -> str:
    """The summary for a terminal: probabilities with their intervals, every failure a count."""
    head = (
        "policy",
        "runs",
        "success",
        "95 % interval",
        "survivors",
        "arrival step",
        "shortfalls",
        "solver failures",
        "resolved",
        "clipped",
    )
    rows = [
        (
            str(row["policy"]),
            f"{row['runs']}",
            f"{row['success']:.4f}" if row["successes"] else "none",
            f"{row['success_low']:.4f} to {row['success_high']:.4f}",
            f"{row['survivors_mean']:.2f}",
            f"{row['arrival_step_mean']:.1f}" if row["successes"] else "-",
            f"{row['shortfalls']}",
            f"{row['solver_failures']}",
            f"{row['resolved']}",
            f"{row['clipped']}",
        )
        for row in summary.to_dict("records")
    ]
    return aligned([head, *rows])

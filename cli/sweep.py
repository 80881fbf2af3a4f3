"""casswarm sweep."""

from __future__ import annotations

import tomllib
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import RESUME, Failure, WrongInput, executor, load, named_policies, reported_errors
from .options import (
    distribution_options,
    figure_options,
    policy_option,
    scenario_options,
    seed_option,
    solver_option,
    study_options,
)
from .output import Folder, aligned, json_text, progress_bar, say

if TYPE_CHECKING:
    from ..studies.sweep import Sweep


@click.command()
@scenario_options
@figure_options
@policy_option
@click.option(
    "--exact", is_flag=True, help="Exact laws, as casswarm evaluate gives them. [default]"
)
@click.option("--runs", type=click.IntRange(1), help="Sample so many runs of every cell instead.")
@seed_option
@distribution_options
@study_options
@solver_option
def sweep(
    scenario: str,
    settings: tuple[str, ...],
    out: Path | None,
    figures: str,
    as_json: bool,
    quiet: bool,
    width: str,
    dpi: int,
    policies: tuple[str, ...],
    exact: bool,
    runs: int | None,
    seed: int,
    tolerance: float,
    max_states: int | None,
    aggregation_tol: float,
    workers: int,
    dask: str | None,
    resume: bool,
    fresh: bool,
    solver: str,
) -> None:
    """Sweep scenario parameters: every combination of values, policy by policy.

    --set KEY=V1,V2,... lists values; KEY=START:STOP:COUNT spaces them evenly, and
    KEY=START:STOP:COUNT:log evenly in the logarithm. KEY is as in the scenario's file, or n
    (members) or spacing (distance of the nearest two at the start). Writes sweep.csv (a row a cell;
    one that failed has its reason), effort.csv, a figure of lines for every parameter with several
    values, a heat map where there are two, and run.json. Cells are kept as they are made: a sweep
    that was stopped goes on with --resume.

    \b
    Examples:
      casswarm sweep paper-1 --set formation.rho=0.01:0.1:5 --policy constrained
      casswarm sweep paper-1 --set hazard.alpha_2=1,3,9 --set spacing=0.2,0.5,1 --workers 2
      casswarm sweep paper-2 --set n=1:6:6 --runs 2000
    """
    with reported_errors(resumes=True), ExitStack() as stack:
        chosen = load(scenario, ())
        grid = dict(map(_values, settings))
        if len(grid) < len(settings):
            raise WrongInput("--set: every key once, with all of its values")
        if not grid:
            raise WrongInput("nothing to sweep: give --set KEY=V1,V2,... at least once")
        if exact and runs is not None:
            raise WrongInput("--exact and --runs: give one of them")
        from ..studies.sweep import sweep as over

        folder = Folder("sweep", chosen, out, figures, RESUME, width, dpi)
        found = over(
            chosen,
            grid,
            named_policies(policies),
            runs=runs,
            seed=seed,
            tolerance=tolerance,
            max_states=max_states,
            aggregation_tol=aggregation_tol,
            solver=solver,
            workers=stack.enter_context(executor(workers, dask)),
            checkpoint=folder.path,
            if_exists="resume" if resume else "overwrite" if fresh else "error",
            progress=None if quiet else progress_bar(stack, "cells", "cell"),
        )
    inputs = {
        "settings": grid,
        "policies": list(dict.fromkeys(found.table["policy"])),
        "runs": runs,
        "seed": seed,
        "tolerance": tolerance,
        "max_states": max_states,
        "aggregation_tol": aggregation_tol,
        "solver": solver,
        "workers": workers,
    }
    content = _write(folder, found, inputs)
    click.echo(json_text(content) if as_json else _words(found))
    say(folder.closing(), quiet)
    if found.failures == len(found.table):
        raise Failure("every cell failed; the reasons are above and in sweep.csv")


def _values(text: str) -> tuple[str, list[Any]]:
    """Key and values of ``--set KEY=...``."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not key or not values:
        raise WrongInput(
            f"--set {text!r} is not of the form KEY=V1,V2,... or KEY=START:STOP:COUNT, "
            "such as formation.rho=0.05,0.1"
        )
    parts = values.split(":")
    if (
        len(parts) > 1
        and not values.startswith(("[", '"', "'"))
        and parts[0][:1] in "+-.0123456789"
    ):
        return key, _range(text, parts)
    try:
        return key, list(tomllib.loads(f"values = [{values}]")["values"])
    except tomllib.TOMLDecodeError:
        return key, [word.strip() for word in values.split(",")]  # bare words, such as global


def _range(text: str, parts: list[str]) -> list[Any]:
    import numpy as np

    spaced = np.geomspace if parts[3:] == ["log"] else np.linspace
    try:
        start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
        if len(parts) > 3 and parts[3:] not in (["log"], ["linear"]):
            raise ValueError
        if count < 1 or (spaced is np.geomspace and min(start, stop) <= 0):
            raise ValueError
    except (ValueError, IndexError):
        raise WrongInput(
            f"--set {text!r}: a range is START:STOP:COUNT or START:STOP:COUNT:log, such as "
            "0.01:0.1:5; COUNT is at least 1, and both ends are above 0 for log"
        ) from None
    values = [float(f"{value:.12g}") for value in spaced(start, stop, count)]
    whole = all(value.is_integer() for value in values) and not set("".join(parts[:3])) & set(".eE")
    return [int(value) for value in values] if whole else values


def _write(folder: Folder, found: Sweep, inputs: dict[str, Any]) -> dict[str, Any]:
    from ..results.catalogue import sweep_figures

    folder.table("sweep", found.table)
    folder.table("effort", found.effort)
    folder.draw(sweep_figures(found.scenario.name, found.table, found.keys))
    return folder.record(
        {"failures": found.failures, "sweep": found.table.to_dict("records")}, inputs
    )


def _words(found: Sweep) -> str:
    sampled = found.table["method"].eq("sampled").all()
    head = (
        *found.keys,
        "policy",
        *(("success", "95 % interval") if sampled else ("success, bracket",)),
        "survivors",
    )
    rows = []
    for row in found.table.to_dict("records"):
        cells = [*(str(row[key]) for key in found.keys), str(row["policy"])]
        if row["status"] != "ok":
            cells += ["failed", *["-"] * (len(head) - len(cells) - 1)]
        else:
            if sampled:
                cells.append("none" if row["successes"] == 0 else f"{row['success']:.4f}")
            cells += [
                f"{row['success_low']:.4f} to {row['success_high']:.4f}",
                f"{row['survivors_mean']:.2f}",
            ]
        rows.append(tuple(cells))
    lines = [aligned([head, *rows])]
    for status, what in (("failed", "failed"), ("ok", "have wider brackets than was asked for")):
        reasons = [
            " ".join(line.strip() for line in row["reason"].splitlines())
            for row in found.table.to_dict("records")
            if row["reason"] and row["status"] == status
        ]
        if reasons:
            lines += ["", f"{len(reasons)} of {len(rows)} cells {what}:", *dict.fromkeys(reasons)]
    return "\n".join([f"{found.scenario.name}", "", *lines])

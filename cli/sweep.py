"""casswarm sweep."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import click

import casswarm as csw

from .._util.text import aligned, counted
from .common import Failure, WrongInput, executor, named_policies, work
from .options import (
    COUNT,
    CommonOptions,
    ExactOptions,
    PolicyOptions,
    StudyOptions,
    option,
    options,
    refuse,
    seed_option,
)

_MAX_COUNT = 1000  # values of a range


@dataclass(frozen=True)
class GridOptions(CommonOptions):
    """Common options, where --set lists values."""

    settings: tuple[str, ...] = option(
        "Sweep over these values of a parameter: V1,V2,..., START:STOP:COUNT or "
        "START:STOP:COUNT:log. Repeatable.",
        "--set",
        metavar="KEY=VALUES",
    )
    report: bool = option(
        "Also write a self-contained report.html, with sliders over the sweep points."
    )


@dataclass(frozen=True)
class MethodOptions:
    """Exact or sampled probabilities."""

    exact: bool = option("Compute exact probabilities, as casswarm evaluate. [default]")
    runs: int | None = option("Simulate this number of runs per sweep point instead.", type=COUNT)
    seed: int = seed_option()


@click.command()
@options
def sweep(
    common: GridOptions,
    policies: PolicyOptions,
    method: MethodOptions,
    accuracy: ExactOptions,
    execution: StudyOptions,
) -> None:
    """Evaluate policies over parameter values.

    Every combination of values is a sweep point. --set KEY=V1,V2,... lists values;
    KEY=START:STOP:COUNT spaces them evenly, and KEY=START:STOP:COUNT:log evenly in the logarithm.
    KEY is a key of the scenario file, or n (number of members) or spacing (smallest initial
    distance between two members). Writes sweep.csv (a row per sweep point; a failed one has its
    reason), effort.csv, a line plot for every parameter with several values, a heat map where there
    are two, and run.json. Results are saved incrementally: resume an interrupted sweep with
    --resume.

    \b
    Examples:
      casswarm sweep paper-1 --set formation.rho=0.01:0.1:5 --policy constrained
      casswarm sweep paper-1 --set hazard.alpha_2=1,3,9 --set spacing=0.2,0.5,1 --workers 2
      casswarm sweep paper-2 --set n=1:6:6 --runs 2000
      casswarm sweep paper-1 --set n=2,3,4,5 --set formation.rho=0.02,0.05,0.1 --report
    """
    if method.exact and method.runs is not None:
        raise WrongInput("--exact and --runs: give one of them")
    if method.runs is None:
        refuse("nothing is sampled without --runs", "seed")
    else:
        refuse("nothing is enumerated with --runs", *(each.name for each in fields(accuracy)))
    grid = _grid(common.settings)
    with work(common) as job:
        chosen = csw.load_scenario(common.scenario, allow_code=common.allow_code)
        chosen_policies = named_policies(policies)
        folder = job.open("sweep", chosen, execution.saved_since)
        settings: dict[str, Any] = {"runs": method.runs, "seed": method.seed, **asdict(accuracy)}
        settings["solver"] = policies.solver
        with executor(execution) as workers:
            result = csw.sweep(
                chosen,
                grid,
                chosen_policies,
                **settings,
                workers=workers,
                checkpoint=job.checkpoint(execution.part),
                if_exists=execution.if_exists,
                progress=job.progress,
            )
        inputs = {
            "settings": grid,
            "policies": list(dict.fromkeys(result.table["policy"])),
            **settings,
            "workers": execution.workers,
        }
        folder.write_tables(sweep=result.table, effort=result.effort)
        folder.write_objects(keys=list(result.keys))
        points = result.table.to_dict("records")
        folder.write_record({"failures": result.failures, "sweep": points}, inputs)
        job.draw()
        if common.report:
            job.report()
        job.finish(_text(result))
        if result.failures == len(result.table):
            raise Failure("every sweep point failed; the reasons are above and in sweep.csv")


def _grid(settings: tuple[str, ...]) -> dict[str, list[Any]]:
    grid = dict(map(_values, settings))
    if len(grid) < len(settings):
        raise WrongInput("--set: give every key once, with all of its values")
    if not grid:
        raise WrongInput("nothing to sweep: give --set KEY=V1,V2,... at least once")
    return grid


def _values(text: str) -> tuple[str, list[Any]]:
    """Key and values of ``--set KEY=...``."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not key or not values:
        raise WrongInput(
            f"--set {text!r} is not of the form KEY=V1,V2,... or KEY=START:STOP:COUNT, "
            "such as formation.rho=0.05,0.1"
        )
    parts = [part.strip() for part in values.split(":")]
    if len(parts) > 1 and _is_number(parts[0]):
        return key, _range(text, key, parts)
    try:
        return key, list(tomllib.loads(f"values = [{values}]")["values"])
    except (ValueError, RecursionError):
        return key, [_value(word.strip()) for word in values.split(",")]


def _value(word: str) -> Any:
    """A value in a list that has bare words, such as global."""
    try:
        return tomllib.loads(f"value = {word}")["value"]
    except ValueError:
        return word


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _range(text: str, key: str, parts: list[str]) -> list[Any]:
    import numpy as np

    from ..scenario.variations import whole_numbers

    spaced = np.geomspace if parts[3:] == ["log"] else np.linspace
    try:
        start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
        known = parts[3:] in ([], ["log"], ["linear"])
        finite = math.isfinite(start) and math.isfinite(stop)
        if not (known and finite and 1 <= count <= _MAX_COUNT):
            raise ValueError
        if spaced is np.geomspace and min(start, stop) <= 0:
            raise ValueError
    except (ValueError, IndexError):
        raise WrongInput(
            f"--set {text!r}: a range is START:STOP:COUNT or START:STOP:COUNT:log, such as "
            f"0.01:0.1:5; START and STOP are finite numbers, above 0 for log, and COUNT is a whole "
            f"number from 1 to {_MAX_COUNT}"
        ) from None
    values: list[Any] = [float(f"{value:.12g}") for value in spaced(start, stop, count)]
    if all(value.is_integer() for value in values) and not set("".join(parts[:3])) & set(".eE"):
        values = [int(value) for value in values]
    try:
        return whole_numbers(key, values)
    except csw.ScenarioError as error:
        raise WrongInput(
            f"--set {text!r}: {error}; choose a COUNT that gives whole numbers, such as "
            f"{key}={_whole_range(start, stop, count)}, or list the numbers, {key}=V1,V2,..."
        ) from None


def _whole_range(start: float, stop: float, count: int) -> str:
    """The range of whole numbers that is most like another range."""
    first, last = math.ceil(min(start, stop)), math.floor(max(start, stop))
    counts = [k for k in range(2, _MAX_COUNT + 1) if (last - first) % (k - 1) == 0]
    return f"{first}:{last}:{min(counts, key=lambda k: abs(k - count))}"


def _text(result: csw.Sweep) -> str:
    sampled = bool(result.table["method"].eq("sampled").all())
    probability = ("success", "95 % interval") if sampled else ("success, bounds",)
    header = (*result.keys, "policy", *probability, "survivors")
    points = result.table.to_dict("records")
    rows = [
        (*(str(point[key]) for key in result.keys), str(point["policy"]), *_numbers(point, sampled))
        for point in points
    ]
    lines = [result.scenario.name, "", aligned([header, *rows], len(result.keys) + 1)]
    for status, what in (("failed", "failed"), ("ok", "have wider bounds than requested")):
        reasons = [
            " ".join(line.strip() for line in point["reason"].splitlines())
            for point in points
            if point["reason"] and point["status"] == status
        ]
        if reasons:
            title = f"{len(reasons)} of {counted(len(points), 'sweep point')} {what}:"
            lines += ["", title, *dict.fromkeys(reasons)]
    return "\n".join(lines)


def _numbers(point: Mapping[Any, Any], sampled: bool) -> tuple[str, ...]:
    """Success and survivors of a sweep point."""
    from ..studies.tables import success_text

    if point["status"] != "ok":
        return ("failed", *["-"] * (2 if sampled else 1))
    return (
        *((success_text(point),) if sampled else ()),
        f"{point['success_low']:.4f} to {point['success_high']:.4f}",
        f"{point['survivors_mean']:.2f}",
    )

"""Options that several commands share: records of fields, each declared once.

A command gets its options as records instead of as twenty parameters::

    @click.command()
    @click.argument("scenario")
    @options(output=OutputOptions, figures=FigureOptions)
    def command(scenario: str, output: OutputOptions, figures: FigureOptions) -> None: ...
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import wraps
from pathlib import Path
from typing import Any, Literal

import click

Command = Callable[..., Any]


def option(*flags: str, **settings: Any) -> Any:
    """Field of a record that a command-line option sets; the arguments are click's."""
    return field(metadata={"flags": flags, "settings": settings})


def options(**records: type[Any]) -> Callable[[Command], Command]:
    """Add the options of records to a command, which gets every record by its keyword.

    The help shows the options in the order of the records.
    """

    def decorate(command: Command) -> Command:
        @wraps(command)
        def parsed(**values: Any) -> Any:
            for name, record in records.items():
                values[name] = record(
                    **{item.name: values.pop(item.name) for item in fields(record)}
                )
            return command(**values)

        declared = [item for record in records.values() for item in fields(record)]
        for item in reversed(declared):
            flags, settings = item.metadata["flags"], item.metadata["settings"]
            parsed = click.option(*flags, item.name, **settings)(parsed)
        return parsed

    return decorate


def out_option(text: str, **settings: Any) -> Any:
    """Field of the folder that results are written to."""
    return option("--out", type=click.Path(file_okay=False, path_type=Path), help=text, **settings)


def seed_option() -> Any:
    """Field of the random seed."""
    return option(
        "--seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed."
    )


def run_option() -> Any:
    """Field of the index of a saved run."""
    return option(
        "--run",
        type=click.IntRange(0),
        default=0,
        show_default=True,
        help="Index of the saved run to show.",
    )


def folder_argument(command: Command) -> Command:
    """Add the argument DIR, the results folder that a command reads."""
    return click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")(command)


@dataclass(frozen=True)
class OutputOptions:
    """What a command writes and prints."""

    out: Path | None = out_option("Folder for the results. [default: results/COMMAND-SCENARIO]")
    as_json: bool = option("--json", is_flag=True, help="Print the result as JSON.")
    quiet: bool = option("--quiet", is_flag=True, help="Print no progress.")


@dataclass(frozen=True)
class CommonOptions(OutputOptions):
    """Options of every command on a scenario."""

    settings: tuple[str, ...] = option(
        "--set",
        multiple=True,
        metavar="KEY=VALUE",
        help="Set a value of the scenario, such as --set formation.rho=0.1, written as in a "
        "scenario file. Repeatable.",
    )


@dataclass(frozen=True)
class FigureOptions:
    """How figures are drawn."""

    format: str = option(
        "--format",
        type=click.Choice(["png", "pdf", "svg"]),
        default="png",
        show_default=True,
        help="File format of the figures.",
    )
    width: str = option(
        "--width",
        type=click.Choice(["column", "page", "slide"]),
        default="page",
        show_default=True,
        help="Width of the figures: a journal column (3.5 in), a page (7.16 in) or a slide "
        "(10 in, large letters).",
    )
    dpi: int = option(
        "--dpi",
        type=click.IntRange(30, 1200),
        default=200,
        show_default=True,
        help="Resolution of PNG figures, in dots per inch.",
    )


@dataclass(frozen=True)
class PolicyOptions:
    """Policies, and what solves their problems."""

    policies: tuple[str, ...] = option(
        "--policy",
        multiple=True,
        metavar="NAME",
        help="Policy to run: naive, constrained, leader, constrained-feedback, leader-feedback, "
        "joint, joint-replanning, leader-mpc-H or constrained-mpc-H with a horizon of H steps, or "
        "your own as module:function. Repeatable. [default: naive, constrained, leader]",
    )
    solver: str = option(
        "--solver",
        default="auto",
        show_default=True,
        help="Solver of the formation problems; casswarm solvers lists them.",
    )


@dataclass(frozen=True)
class GuideOptions:
    """How the guide is planned."""

    search: str | None = option(
        "--search",
        type=click.Choice(["local", "global"]),
        help="Optimize the guide from the straight line only, or also from the best path of every "
        "homotopy class. [default: set by the scenario]",
    )
    arrival: str | None = option(
        "--arrival",
        type=click.Choice(["any", "horizon"]),
        help="Choose the guide's best arrival step, or arrive at the last step. "
        "[default: set by the scenario]",
    )

    @property
    def values(self) -> dict[str, Any]:
        """Values of the scenario that the options replace."""
        return {f"guide.{item.name}": getattr(self, item.name) for item in fields(self)}


@dataclass(frozen=True)
class ExactOptions:
    """How far outcome distributions are enumerated."""

    tolerance: float = option(
        "--tolerance",
        type=click.FloatRange(0, 1, max_open=True),
        default=1e-3,
        show_default=True,
        help="Width of the probability bounds.",
    )
    max_states: int | None = option(
        "--max-states",
        type=click.IntRange(1),
        help="Maximum number of states to enumerate; bounds may be wider than the tolerance. "
        "[default: 1000000, or 10000 with more than 12 members]",
    )
    aggregation_tol: float = option(
        "--aggregation-tol",
        type=click.FloatRange(0),
        default=0.0,
        show_default=True,
        help="Aggregate states that are closer than this, such as 1e-6. This needs far fewer "
        "states, but the bounds are proven only at 0.",
    )


@dataclass(frozen=True)
class StudyOptions:
    """Workers and checkpoints of a study."""

    workers: int = option(
        "--workers",
        type=click.IntRange(1),
        default=1,
        show_default=True,
        help="Number of worker processes (does not affect results).",
    )
    dask: str | None = option(
        "--dask",
        metavar="ADDRESS",
        help="Run on the Dask cluster at this address, such as tcp://127.0.0.1:8786. "
        "Needs the extra: pip install 'casswarm[dask]'.",
    )
    resume: bool = option(
        "--resume",
        is_flag=True,
        help="Resume an interrupted study with the same inputs from its folder.",
    )
    overwrite: bool = option(
        "--overwrite", is_flag=True, help="Discard an unfinished study and start over."
    )

    @property
    def if_exists(self) -> Literal["error", "resume", "overwrite"]:
        """What happens to an unfinished study in the folder."""
        return "resume" if self.resume else "overwrite" if self.overwrite else "error"

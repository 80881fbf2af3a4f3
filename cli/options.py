"""Options of the commands that evaluate policies: accuracy, workers, checkpoints.

Options that several commands share: records of fields, each declared once.

A command gets its arguments and options as records instead of as twenty parameters::

    @click.command()
    @options
    def command(common: CommonOptions, policies: PolicyOptions) -> None: ...
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import partial, wraps
from pathlib import Path
from typing import Any, Literal, get_type_hints

import click
from click.core import ParameterSource

from .._util.numbers import MAX_SEED
from . import completion


class Number(click.FloatRange):
    """A number of a range, neither NaN nor infinite; `infinite` allows it to be infinite."""

    def __init__(
        self, low: float, high: float | None = None, *, infinite: bool = False, **settings: Any
    ) -> None:
        super().__init__(low, high, **settings)
        self.infinite = infinite

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Number that a text means."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number) or (math.isinf(number) and not self.infinite):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


Command = Callable[..., Any]


def argument(**settings: Any) -> Any:
    """Field of a record that a command-line argument sets; `settings` are click's."""
    return field(metadata={"declare": partial(click.argument, **settings)})


def option(*flags: str, **settings: Any) -> Any:
    """Field of a record that a command-line option sets; `settings` are click's.

    The help shows the default if one is given.
    """
    settings = {"show_default": settings.get("default") is not None, **settings}
    return field(metadata={"declare": partial(click.option, *flags, **settings)})


def options(command: Command) -> Command:
    """Add the arguments and options that the records declare of which a command's parameters are.

    The help shows the options in the order of the records.
    """
    records = get_type_hints(command)
    del records["return"]

    @wraps(command)
    def parsed(**values: Any) -> Any:
        for name, record in records.items():
            values[name] = record(**{item.name: values.pop(item.name) for item in fields(record)})
        return command(**values)

    declared = [item for record in records.values() for item in fields(record)]
    for item in reversed(declared):
        parsed = item.metadata["declare"](item.name)(parsed)
    return parsed


def refuse(reason: str, *names: str) -> None:
    """Raise a UsageError if one of these options, which would have no effect, is given.

    `names` are those of the fields that the options set.
    """
    context = click.get_current_context()
    given = [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names
        and context.get_parameter_source(parameter.name) is not ParameterSource.DEFAULT
    ]
    if given:
        verb = "does" if len(given) == 1 else "do"
        raise click.UsageError(f"{', '.join(given)} {verb} not apply: {reason}")


def out_option(text: str, **settings: Any) -> Any:
    """Field of the folder that results are written to."""
    return option("--out", type=click.Path(file_okay=False, path_type=Path), help=text, **settings)


def seed_option() -> Any:
    """Field of the random seed."""
    return option("--seed", type=click.IntRange(0, MAX_SEED), default=0, help="Random seed.")


def quiet_option() -> Any:
    """Field of the switch that silences progress."""
    return option("--quiet", is_flag=True, help="Print no progress.")


def allow_code_option() -> Any:
    """Field of the consent to run what a scenario names."""
    return option(
        "--allow-code",
        is_flag=True,
        help="Import and run the function that the scenario names as its hazard. Only for files "
        "that you trust.",
    )


@dataclass(frozen=True)
class OutputOptions:
    """What a command writes and prints."""

    out: Path | None = out_option("Folder for the results. [default: results/COMMAND-SCENARIO]")
    as_json: bool = option("--json", is_flag=True, help="Print the result as JSON.")
    quiet: bool = quiet_option()


@dataclass(frozen=True)
class ScenarioInput:
    """The scenario and its values."""

    scenario: str = argument(shell_complete=completion.scenarios)
    settings: tuple[str, ...] = option(
        "--set",
        multiple=True,
        metavar="KEY=VALUE",
        help="Set a value of the scenario, such as --set formation.rho=0.1, written as in a "
        "scenario file. Repeatable.",
    )
    allow_code: bool = allow_code_option()


@dataclass(frozen=True)
class ScenarioOptions(ScenarioInput, OutputOptions):
    """The scenario, and what is written and printed."""


@dataclass(frozen=True)
class FigureOptions:
    """How figures are drawn."""

    format: str = option(
        "--format",
        type=click.Choice(["png", "pdf", "svg"]),
        default="png",
        help="File format of the figures.",
    )
    width: Literal["column", "page", "slide"] = option(
        "--width",
        type=click.Choice(["column", "page", "slide"]),
        default="page",
        help="Width of the figures: a journal column (3.5 in), a page (7.16 in) or a slide "
        "(10 in, large letters).",
    )
    dpi: int = option(
        "--dpi",
        type=click.IntRange(30, 1200),
        default=200,
        help="Resolution of PNG figures, in dots per inch.",
    )


@dataclass(frozen=True)
class DrawingOptions(FigureOptions):
    """Whether figures are drawn, and how."""

    no_figures: bool = option(
        "--no-figures", is_flag=True, help="Draw no figures; casswarm plot draws them later."
    )

    def __post_init__(self) -> None:
        if self.no_figures:
            refuse("nothing is drawn with --no-figures", "format", "width", "dpi")


@dataclass(frozen=True)
class CommonOptions(DrawingOptions, ScenarioOptions):
    """Options of every command on a scenario."""


@dataclass(frozen=True)
class VerboseOptions:
    """How much is said."""

    verbose: bool = option(
        "--verbose",
        is_flag=True,
        help="Print Ipopt's iterations and all log messages, with the names of their loggers.",
    )

    def __post_init__(self) -> None:
        if self.verbose:
            refuse("everything is printed with --verbose", "quiet")


@dataclass(frozen=True)
class SavedRunOptions:
    """A results folder, and which of its runs is shown."""

    folder: Path = argument(
        type=click.Path(path_type=Path), metavar="DIR", shell_complete=completion.results
    )
    run: int = option(
        "--run", type=click.IntRange(0), default=0, help="Index of the saved run to show."
    )
    allow_code: bool = allow_code_option()


@dataclass(frozen=True)
class PolicyOptions:
    """Policies, and what solves their problems."""

    policies: tuple[str, ...] = option(
        "--policy",
        multiple=True,
        metavar="NAME",
        shell_complete=completion.policies,
        help="Policy to run: naive, constrained, leader, constrained-feedback, leader-feedback, "
        "joint, joint-replanning, optimal (for two members), leader-mpc-H or constrained-mpc-H "
        "with a horizon of H steps, or your own as module:function. Repeatable. "
        "[default: naive, constrained, leader]",
    )
    policy_time_limit: float | None = option(
        "--policy-time-limit",
        type=Number(0, min_open=True),
        metavar="SECONDS",
        help="Time limit for a call of your own policies, in seconds. On a Dask cluster and on "
        "Windows a call is not interrupted, but fails when it ends. [default: none]",
    )
    solver: str = option(
        "--solver",
        default="auto",
        shell_complete=completion.solvers,
        help="Solver of the formation problems; casswarm solvers lists them. With "
        "projected-gradient, the paper's method, the guides are planned by it, too.",
    )

    def __post_init__(self) -> None:
        if not any(":" in name for name in self.policies):
            refuse("no policy is your own, module:function", "policy_time_limit")


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
        type=Number(0, 1, max_open=True),
        default=1e-3,
        help="Width of the probability bounds.",
    )
    max_states: int | None = option(
        "--max-states",
        type=click.IntRange(1),
        help="Maximum number of states to enumerate; bounds may be wider than the tolerance. "
        "[default: 1000000, or 10000 with more than 12 members]",
    )
    aggregation_tol: float | None = option(
        "--aggregation-tol",
        type=Number(0),
        help="Round the members' motion to a lattice of at most this spacing, so that nearly equal "
        "states coincide; 0 rounds nothing. The bounds are those of the policy with rounded "
        "commands. [default: 1.2e-7 v_max dt, the accuracy of solvers]",
    )


@dataclass(frozen=True)
class StudyOptions:
    """Workers and checkpoints of a study."""

    workers: int = option(
        "--workers",
        type=click.IntRange(1),
        default=1,
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

    def __post_init__(self) -> None:
        if self.resume and self.overwrite:
            raise click.UsageError("--resume and --overwrite: give one of them")
        if self.dask is not None:
            refuse("the workers are those of the cluster, --dask", "workers")

    @property
    def saved_since(self) -> float:
        """Time from which saved work is of this study: always if it is resumed, else now."""
        return 0.0 if self.resume else time.time()

    @property
    def if_exists(self) -> Literal["error", "resume", "overwrite"]:
        """What happens to an unfinished study in the folder."""
        return "resume" if self.resume else "overwrite" if self.overwrite else "error"

"""Options: records of fields, each declared once, and what the shell completes.

A command gets its arguments and options as records instead of as twenty parameters::

    @click.command()
    @options
    def command(common: CommonOptions, policies: PolicyOptions) -> None: ...
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, is_dataclass
from functools import wraps
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import click
from click import Context, Parameter
from click.core import ParameterSource
from click.shell_completion import CompletionItem

import casswarm as csw

from .._util.numbers import MAX_SEED
from .._util.parts import MAX_PARTS, Part


def complete_scenario(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Built-in scenarios, and files, which shells complete themselves."""
    return [*_matching(csw.builtin_scenarios(), incomplete), CompletionItem(incomplete, "file")]


def complete_policy(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Policies by name."""
    from ..policies.named import POLICIES

    return _matching(POLICIES, incomplete)


def complete_solver(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Solvers by name."""
    return _matching(csw.solvers.SOLVERS, incomplete)


def complete_results(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Results folders below results/, and other folders, which shells complete themselves."""
    records = sorted(Path("results").glob("*/run.json"))
    found = _matching((record.parent.as_posix() for record in records), incomplete)
    return [*found, CompletionItem(incomplete, "dir")]


def _matching(names: Iterable[str], incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(incomplete)]


class Number(click.FloatRange):
    """A number of a range, neither NaN nor infinite; `infinite` allows it to be infinite."""

    def __init__(
        self, low: float, high: float | None = None, *, infinite: bool = False, **settings: Any
    ) -> None:
        super().__init__(low, high, **settings)
        self.infinite = infinite

    def convert(self, value: Any, param: Parameter | None, ctx: Context | None) -> float:
        """Number that a text means."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number) or (math.isinf(number) and not self.infinite):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class AmbiguityText(click.types.StringParamType):
    """A set of priors: mean, worst, cvar:A or tv:R."""

    name = "ambiguity"

    def convert(self, value: Any, param: Parameter | None, ctx: Context | None) -> Any:
        """What `casswarm.plan` takes."""
        from ..errors import PlanningError
        from ..guide import Ambiguity

        name, colon, parameter = str(value).partition(":")
        try:
            chosen = (name, float(parameter)) if colon else name
            Ambiguity.of(chosen)  # type: ignore[arg-type]
        except (ValueError, PlanningError):
            self.fail(
                f"{value!r} is no set of priors: mean, worst, cvar:A with A above 0 and at most 1, "
                "such as cvar:0.3, or tv:R with R from 0 to 2",
                param,
                ctx,
            )
        return chosen


class PartText(click.types.StringParamType):
    """A part of a study, k/K."""

    name = "part"

    def convert(self, value: Any, param: Parameter | None, ctx: Context | None) -> Any:
        """The part."""
        number, slash, count = str(value).partition("/")
        digits = slash and number.isdecimal() and count.isdecimal() and len(str(value)) < 20
        if not digits or not 1 <= int(number) <= int(count) <= MAX_PARTS:
            limit = f"with K up to {MAX_PARTS}"
            self.fail(f"{value!r} is not of the form k/K, such as 3/64, {limit}", param, ctx)
        return Part(int(number), int(count))


POSITIVE = Number(0, min_open=True)
COUNT = click.IntRange(1)
FOLDER = click.Path(file_okay=False, path_type=Path)

Command = Callable[..., Any]


def argument(**settings: Any) -> Any:
    """Field of a record that a command-line argument sets; `settings` are click's."""
    return field(metadata={"settings": settings})


def option(text: str, *flags: str, **settings: Any) -> Any:
    """Field of a record that a command-line option sets.

    Parameters
    ----------
    text : str
        Its help, which also shows the default if one is given.
    *flags : str
        By default --NAME, of the field.
    **settings
        Click's. What they leave open follows from the field's type: bool is a switch, a tuple is
        repeatable, a Literal is a choice.
    """
    shown = {"help": text, "show_default": settings.get("default") is not None}
    return field(metadata={"flags": flags, "settings": shown | settings})


def options(command: Command) -> Command:
    """Add the arguments and options that the records declare of which a command's parameters are.

    The help shows the options in the order of the records.
    """
    hints = get_type_hints(command)
    records: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}

    def parsed(**values: Any) -> Any:
        for name, record in records.items():
            values[name] = record(**{item.name: values.pop(item.name) for item in fields(record)})
        return command(**values)

    declared: Command = wraps(command)(parsed)
    for record in reversed(records.values()):
        types = get_type_hints(record)
        for item in reversed(fields(record)):
            declared = _declaration(item.name, types[item.name], **item.metadata)(declared)
    return declared


def _declaration(
    name: str, kind: Any, settings: dict[str, Any], flags: tuple[str, ...] | None = None
) -> Callable[[Command], Command]:
    """Click's decorator of a field, None as `flags` for an argument."""
    if NoneType in get_args(kind):
        kind = next(part for part in get_args(kind) if part is not NoneType)
    implied: dict[str, Any] = {}
    if get_origin(kind) is tuple:
        kind, implied = get_args(kind)[0], {"nargs": -1} if flags is None else {"multiple": True}
    if get_origin(kind) is Literal:
        implied["type"] = click.Choice(get_args(kind))
    elif kind is Path:
        implied["type"] = click.Path(path_type=Path)
    elif kind is bool and "/" not in "".join(flags or ()):
        implied["is_flag"] = True
    if flags is None:
        return click.argument(name, **implied | settings)
    return click.option(*flags or [f"--{name.replace('_', '-')}"], name, **implied | settings)


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


def out_option(text: str = "[default: results/COMMAND-SCENARIO]") -> Any:
    """Field of the folder that results are written to."""
    return option(f"Folder for the results. {text}", "--out", type=FOLDER)


def seed_option() -> Any:
    """Field of the random seed."""
    return option("Random seed.", type=click.IntRange(0, MAX_SEED), default=0)


def part_option() -> Any:
    """Field of the part of a study."""
    return option(
        "Compute only part k of K and save it in --out; casswarm merge joins all parts.",
        type=PartText(),
        metavar="k/K",
    )


def quiet_option() -> Any:
    """Field of the switch that silences progress."""
    return option("Print no progress.")


def policy_option(text: str, **settings: Any) -> Any:
    """Field of names of policies."""
    return option(text, "--policy", metavar="NAME", shell_complete=complete_policy, **settings)


def solver_option(text: str, **settings: Any) -> Any:
    """Field of names of solvers."""
    return option(text, "--solver", shell_complete=complete_solver, **settings)


def scenario_argument(**settings: Any) -> Any:
    """Field of scenarios."""
    return argument(shell_complete=complete_scenario, **settings)


def allow_code_option() -> Any:
    """Field of the consent to run what a scenario names."""
    return option(
        "Import and run the function that the scenario names as its hazard. Only for files that "
        "you trust."
    )


@dataclass(frozen=True)
class OutputOptions:
    """Options of written and printed output."""

    out: Path | None = out_option()
    as_json: bool = option("Print the result as JSON.", "--json")
    quiet: bool = quiet_option()


@dataclass(frozen=True)
class ScenarioInput:
    """The scenario and its values."""

    scenario: str = scenario_argument()
    settings: tuple[str, ...] = option(
        "Set a value of the scenario, such as --set formation.rho=0.1, written as in a scenario "
        "file, or the number of members, n, or the spacing of their positions. Repeatable.",
        "--set",
        metavar="KEY=VALUE",
    )
    allow_code: bool = allow_code_option()


@dataclass(frozen=True)
class FigureOptions:
    """Format, width and resolution of figures."""

    format: Literal["png", "pdf", "svg"] = option("File format of the figures.", default="png")
    width: Literal["column", "page", "slide"] = option(
        "Width of the figures: a journal column (3.5 in), a page (7.16 in) or a slide (10 in, "
        "large letters).",
        default="page",
    )
    dpi: int = option(
        "Resolution of PNG figures, in dots per inch.", type=click.IntRange(30, 1200), default=200
    )


@dataclass(frozen=True)
class DrawingOptions(FigureOptions):
    """Options of drawing figures, or none."""

    no_figures: bool = option("Draw no figures; casswarm plot draws them later.")

    def __post_init__(self) -> None:
        if self.no_figures:
            refuse("nothing is drawn with --no-figures", "format", "width", "dpi")


@dataclass(frozen=True)
class ResultOptions(DrawingOptions, OutputOptions):
    """Options of every command that writes a results folder."""


@dataclass(frozen=True)
class CommonOptions(ResultOptions, ScenarioInput, OutputOptions):
    """Options of every command on a scenario that writes a results folder."""


@dataclass(frozen=True)
class VerboseOptions:
    """Verbosity of a command."""

    verbose: bool = option(
        "Print Ipopt's iterations and all log messages, with the names of their loggers."
    )

    def __post_init__(self) -> None:
        if self.verbose:
            refuse("everything is printed with --verbose", "quiet")


@dataclass(frozen=True)
class SavedRunOptions:
    """A results folder, and which of its runs is shown."""

    folder: Path = argument(metavar="DIR", shell_complete=complete_results)
    run: int = option("Index of the saved run to show.", type=click.IntRange(0), default=0)
    allow_code: bool = allow_code_option()


@dataclass(frozen=True)
class PolicyOptions:
    """Policies, and what solves their problems."""

    policies: tuple[str, ...] = policy_option(
        "Policy to run: naive, constrained, leader, constrained-feedback, leader-feedback, joint, "
        "joint-replanning, optimal (for two members), leader-mpc-H or constrained-mpc-H with a "
        "horizon of H steps, or your own as module:function. Repeatable. "
        "[default: naive, constrained, leader]"
    )
    policy_time_limit: float | None = option(
        "Time limit for a call of your own policies, in seconds. On a Dask cluster and on Windows "
        "a call is not interrupted, but fails when it ends. [default: none]",
        type=POSITIVE,
        metavar="SECONDS",
    )
    solver: str = solver_option(
        "Solver of the formation problems; casswarm solvers lists them. With projected-gradient, "
        "the paper's method, the guides are planned by it, too.",
        default="auto",
    )

    def __post_init__(self) -> None:
        if not any(":" in name for name in self.policies):
            refuse("no policy is your own, module:function", "policy_time_limit")


@dataclass(frozen=True)
class GuideOptions:
    """Options of planning the guide."""

    search: Literal["local", "global"] | None = option(
        "Optimize the guide from the straight line only, or also from the best path of every "
        "homotopy class. [default: set by the scenario]"
    )
    arrival: Literal["any", "horizon"] | None = option(
        "Choose the guide's best arrival step, or arrive at the last step. "
        "[default: set by the scenario]"
    )

    @property
    def values(self) -> dict[str, Any]:
        """Values of the scenario that the options replace."""
        return {f"guide.{item.name}": getattr(self, item.name) for item in fields(self)}


@dataclass(frozen=True)
class ExactOptions:
    """Accuracy and limits of enumerating outcome distributions."""

    tolerance: float = option(
        "Width of the probability bounds.", type=Number(0, 1, max_open=True), default=1e-3
    )
    max_states: int | None = option(
        "Maximum number of states to enumerate; bounds may be wider than the tolerance. "
        "[default: 1000000, or 10000 with more than 12 members]",
        type=COUNT,
    )
    aggregation_tol: float | None = option(
        "Round the members' motion to a lattice of at most this spacing, so that nearly equal "
        "states coincide; 0 rounds nothing. The bounds are those of the policy with rounded "
        "commands. [default: 1.2e-7 v_max dt, the accuracy of solvers]",
        type=Number(0),
    )
    memory: float | None = option(
        "Megabytes that states may take; the least probable beyond it are left out, and the bounds "
        "are wider. [default: 537]",
        type=Number(1),
    )


@dataclass(frozen=True)
class StudyOptions:
    """Workers and checkpoints of a study."""

    workers: int = option(
        "Number of worker processes (does not affect results).", type=COUNT, default=1
    )
    dask: str | None = option(
        "Run on the Dask cluster at this address, such as tcp://127.0.0.1:8786. "
        "Needs the extra: pip install 'casswarm[dask]'.",
        metavar="ADDRESS",
    )
    resume: bool = option("Resume an interrupted study with the same inputs from its folder.")
    overwrite: bool = option("Discard an unfinished study and start over.")
    part: Part | None = part_option()

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
        """Treatment of an unfinished study in the folder."""
        return "resume" if self.resume else "overwrite" if self.overwrite else "error"

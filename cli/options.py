"""Options that several commands have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])


def _together(*options: Callable[[Any], Any]) -> Callable[[F], F]:
    """One decorator of several options, which the help shows in this order."""

    def decorate(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def out_option(told: str, **more: Any) -> Callable[[F], F]:
    """Where the results go."""
    kind = click.Path(file_okay=False, path_type=Path)
    return click.option("--out", type=kind, help=told, **more)


policy_option = click.option(
    "--policy",
    "policies",
    multiple=True,
    metavar="NAME",
    help="naive, constrained, leader, constrained-feedback, leader-feedback, joint, "
    "joint-replanning, with H steps in view leader-mpc-H and constrained-mpc-H (H a number), or "
    "your own as module:function; repeatable. [default: the first three]",
)
"""Which policies a command works on."""

solver_option = click.option(
    "--solver", default="auto", show_default=True, help="Of the formation problems; see solvers."
)
"""What solves the policies' problems."""

seed_option = click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the runs."
)
"""Of random numbers."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
"""What is for machines."""

quiet_option = click.option("--quiet", is_flag=True, help="No progress.")
"""What is not to be said on the way."""

kept_run_options = _together(
    click.argument("folder", type=click.Path(path_type=Path), metavar="DIR"),
    click.option(
        "--run",
        type=click.IntRange(0),
        default=0,
        show_default=True,
        help="Which of the runs that casswarm simulate kept.",
    ),
)
"""DIR, and a run that is kept there."""

figure_options = _together(
    click.option(
        "--format",
        "figures",
        type=click.Choice(["png", "pdf", "svg"]),
        default="png",
        show_default=True,
        help="Of the figures.",
    ),
    click.option(
        "--width",
        type=click.Choice(["column", "page", "slide"]),
        default="page",
        show_default=True,
        help="Of the figures: a journal's column (3.5 in), a page (7.16 in) or a slide "
        "(10 in, large letters).",
    ),
    click.option(
        "--dpi",
        type=click.IntRange(30, 1200),
        default=200,
        show_default=True,
        help="Of figures as PNG.",
    ),
)
"""How figures are drawn."""

distribution_options = _together(
    click.option(
        "--tolerance",
        type=click.FloatRange(0, 1, max_open=True),
        default=1e-3,
        show_default=True,
        help="Width of the brackets of exact laws.",
    ),
    click.option(
        "--max-states",
        type=click.IntRange(1),
        help="States solved at the most; brackets may get wider. "
        "[default: a million, or 10000 with more than 12 members]",
    ),
    click.option(
        "--aggregation-tol",
        "aggregation_tol",
        type=click.FloatRange(0),
        default=0.0,
        show_default=True,
        help="Take states in one cell of a grid of this width for equal, such as 1e-6: far fewer "
        "states, but brackets are proven at 0 only.",
    ),
)
"""How far exact laws are followed."""

study_options = _together(
    click.option(
        "--workers",
        type=click.IntRange(1),
        default=1,
        show_default=True,
        help="Processes that share the work; changes no number.",
    ),
    click.option(
        "--dask",
        metavar="ADDRESS",
        help="Send the work to a Dask cluster, such as tcp://127.0.0.1:8786, instead. "
        "Needs the extra: pip install 'casswarm[dask]'.",
    ),
    click.option(
        "--resume",
        is_flag=True,
        help="Go on with what an interrupted run left in the folder; inputs as before.",
    ),
    click.option("--fresh", is_flag=True, help="Begin anew in a folder with an unfinished study."),
)
"""Of the commands that keep their results as they are made, and may share the work."""

scenario_options = _together(
    click.argument("scenario"),
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help="Change a value of the scenario, for example --set formation.rho=0.1; "
        "the value is written as in the file. Repeatable.",
    ),
    out_option("Folder for the results. [default: results/COMMAND-NAME]"),
    json_option,
    quiet_option,
)
"""SCENARIO, and the options that every command on a scenario takes."""

"""casswarm evaluate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import load, policy_option, reported_errors, scenario_options
from .output import Folder, aligned, json_text, say

if TYPE_CHECKING:
    from ..chain.evaluate import Law
    from ..scenario import Scenario


@click.command()
@scenario_options
@policy_option
@click.option(
    "--tolerance",
    type=click.FloatRange(0, 1, max_open=True),
    default=1e-3,
    show_default=True,
    help="Width of the brackets.",
)
@click.option(
    "--most-states",
    type=click.IntRange(1),
    default=200_000,
    show_default=True,
    help="Distinct states kept at a step at the most: bounds memory; brackets may get wider.",
)
@click.option(
    "--solver", default="auto", show_default=True, help="Of the formation problems; see solvers."
)
def evaluate(
    scenario: str,
    settings: tuple[str, ...],
    out: Path | None,
    figures: str,
    as_json: bool,
    quiet: bool,
    policies: tuple[str, ...],
    tolerance: float,
    most_states: int,
    solver: str,
) -> None:
    """Compute how often the swarm reaches the target, exactly: brackets, no sampling.

    For at most 12 members. Prints a table and writes laws.csv, arrival.csv (probability of the
    first arrival at every step), survivors.csv, arrival.png and run.json.

    \b
    Examples:
      casswarm evaluate paper-1
      casswarm evaluate paper-2 --policy leader --tolerance 1e-4
    """
    with reported_errors():
        chosen = load(scenario, settings)
        from ..evaluation import evaluate as exact_law
        from ..planning import plan
        from ..study import PAPER_POLICIES

        folder = Folder("evaluate", chosen, out, figures)
        guide = plan(chosen)
        laws = []
        for policy in policies or PAPER_POLICIES:
            say(f"evaluating {policy}", quiet)
            laws.append(
                exact_law(
                    chosen, policy, tolerance, most_states=most_states, guide=guide, solver=solver
                )
            )
    inputs = {"tolerance": tolerance, "most_states": most_states, "solver": solver}
    content = _write(folder, chosen, laws, inputs)
    click.echo(json_text(content) if as_json else _words(chosen, laws, tolerance))
    say(folder.closing(), quiet)


def _write(
    folder: Folder, scenario: Scenario, laws: list[Law], inputs: dict[str, Any]
) -> dict[str, Any]:
    from ..figures import arrival_chart
    from ..tables import arrival_table, law_table, survivor_table

    table = law_table(laws)
    folder.table("laws", table)
    folder.table("arrival", arrival_table(laws))
    folder.table("survivors", survivor_table(laws))
    folder.figure("arrival", arrival_chart(laws, scenario.name))
    return folder.record({"laws": table.to_dict("records")}, inputs)


def _words(scenario: Scenario, laws: list[Law], tolerance: float) -> str:
    head = ("policy", "success, bracket", "survivors", "states", "shortfalls", "solver failures")
    rows = [
        (
            law.policy,
            f"{law.success[0]:.6f} to {law.success[1]:.6f}",
            f"{law.survivors_mean[0]:.3f} to {law.survivors_mean[1]:.3f}",
            f"{law.states}",
            f"{law.shortfalls:.2f}",
            f"{law.failures:.4f}",
        )
        for law in laws
    ]
    wide = [law.policy for law in laws if law.unresolved > tolerance]
    note = (
        f"\n\nwider than {tolerance:g}: {', '.join(wide)}; --most-states was too few for it"
        if wide
        else ""
    )
    return (
        f"{scenario.name}, exact law; counts are means of a run\n\n{aligned([head, *rows])}{note}"
    )

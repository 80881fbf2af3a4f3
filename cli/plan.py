"""casswarm plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import WrongInput, load, reported_errors, scenario_options
from .output import Folder, json_text, say

if TYPE_CHECKING:
    from ..guide import Guide
    from ..scenario import Scenario


@click.command()
@scenario_options
@click.option(
    "--solver",
    default="ipopt",
    show_default=True,
    help="ipopt, or projected-gradient for the paper's penalised form.",
)
@click.option(
    "--search",
    type=click.Choice(["local", "global"]),
    help="From the straight line only, or from ways on both sides of every radar. "
    "[default: the scenario's]",
)
@click.option(
    "--arrival",
    type=click.Choice(["any", "horizon"]),
    help="Choose the best arrival step, or use all the time. [default: the scenario's]",
)
@click.option("--flyable/--not-flyable", default=None, help="Whether the guide respects a_max.")
def plan(
    scenario: str,
    settings: tuple[str, ...],
    out: Path | None,
    figures: str,
    as_json: bool,
    quiet: bool,
    solver: str,
    search: str | None,
    arrival: str | None,
    flyable: bool | None,
) -> None:
    """Find the least risky path of a lone agent: the guide that the swarm follows.

    Writes guide.csv (a row a step), candidates.csv (every start's outcome), guide.png and run.json.

    \b
    Examples:
      casswarm plan paper-1
      casswarm plan paper-1 --search global --arrival any
      casswarm plan my-scenario.toml --set guide.a_max=0.3 --json
    """
    if solver == "projected-gradient" and (search, arrival, flyable) != (None, None, None):
        raise WrongInput(
            "the paper's projected gradient starts from the straight line, takes all the time and "
            "knows no a_max: --search, --arrival and --flyable do not apply to it"
        )
    with reported_errors():
        chosen = load(
            scenario,
            settings,
            guide__search=search,
            guide__arrival=arrival,
            guide__flyable=flyable,
        )
        from ..planning import plan as find_guide

        folder = Folder("plan", chosen, out, figures)
        guide = find_guide(
            chosen, solver, progress=lambda start: say(f"planning: from {start}", quiet)
        )
    content = _write(folder, chosen, guide, {"solver": solver})
    click.echo(json_text(content) if as_json else _words(chosen, guide))
    say(folder.closing(), quiet)


def _write(
    folder: Folder, scenario: Scenario, guide: Guide, inputs: dict[str, object]
) -> dict[str, object]:
    from ..figures import guide_map
    from ..tables import candidate_table, guide_table

    folder.table("guide", guide_table(guide))
    folder.table("candidates", candidate_table(guide))
    folder.figure("guide", guide_map(scenario, guide, guide.ways()))
    result = {
        "risk": guide.risk,
        "survival": guide.survival,
        "risk_bound": guide.risk_bound,
        "gap": guide.gap,
        "arrival_step": guide.arrival,
        "arrives": guide.arrives,
        "solution": guide.solution.as_row(),
        "positions": guide.positions,
        "velocities": guide.velocities,
    }
    return folder.record(result, inputs)


def _words(scenario: Scenario, guide: Guide) -> str:
    from collections import Counter

    outcomes = Counter(str(candidate.solution.status) for candidate in guide.candidates)
    told = ", ".join(f"{count} {status}" for status, count in outcomes.items())
    radars = len(scenario.hazard.radar_positions)
    lines = [
        f"{scenario.name}: {scenario.n} members, {radars} radars, "
        f"{scenario.n_steps} steps of {scenario.time.dt:g}",
        f"{guide}, risk {guide.risk:.4f}",
        f"{guide.solution}",
        f"solves: {told}",
    ]
    if not guide.solution.status.success:
        lines.append("the solver did not converge: this is its best path, not a minimum")
    elif guide.search == "local" or scenario.guide.arrival == "horizon":
        lines.append("a local search: --search global --arrival any may find a better way")
    return "\n".join(lines)

"""casswarm plan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import WrongInput, load, reported_errors
from .options import figure_options, scenario_options
from .output import Folder, json_text, say
from .plan_joint import plan_joint

if TYPE_CHECKING:
    from ..planning.bounds.outlook import CostToGoMap
    from ..planning.bounds.value_function import ValueFunction
    from ..planning.guide import Guide
    from ..scenario import Scenario

_WAYS = 6  # that are printed; candidates.csv has them all


@click.command()
@scenario_options
@figure_options
@click.option(
    "--solver",
    default="ipopt",
    show_default=True,
    help="ipopt, or projected-gradient for the paper's penalised form.",
)
@click.option(
    "--search",
    type=click.Choice(["local", "global"]),
    help="From the straight line only, or also from the ways that dynamic programming finds. "
    "[default: the scenario's]",
)
@click.option(
    "--arrival",
    type=click.Choice(["any", "horizon"]),
    help="Choose the best arrival step, or use all the time. [default: the scenario's]",
)
@click.option(
    "--acceleration_limited/--not-acceleration_limited",
    default=None,
    help="Whether the guide respects a_max.",
)
@click.option(
    "--certify/--no-certify", default=True, help="Prove how good any guide can be. [default: yes]"
)
@click.option(
    "--gap",
    type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True),
    default=0.01,
    show_default=True,
    help="Relative distance of the bound from the best known risk at which the proof may end.",
)
@click.option(
    "--time-limit",
    type=click.FloatRange(0.0, min_open=True),
    default=10.0,
    show_default=True,
    help="Seconds that the proof may take.",
)
@click.option("--map", "with_map", is_flag=True, help="Draw the risk to go from every place, too.")
@click.option("--joint", is_flag=True, help="Plan the ways of all members at once.")
@click.option(
    "--objective",
    type=click.Choice(["success", "arrivals", "survivors"]),
    default="success",
    show_default=True,
    help="Of the joint plan: probability that somebody arrives, mean number who do, or mean number "
    "alive at the end.",
)
@click.option(
    "--min-distance",
    type=click.FloatRange(0.0, min_open=True),
    help="Of the joint plan: least distance of any two members.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Of the joint plan's perturbed starts.",
)
def plan(
    scenario: str,
    settings: tuple[str, ...],
    out: Path | None,
    figures: str,
    as_json: bool,
    quiet: bool,
    width: str,
    dpi: int,
    solver: str,
    search: str | None,
    arrival: str | None,
    acceleration_limited: bool | None,
    certify: bool,
    gap: float,
    time_limit: float,
    with_map: bool,
    joint: bool,
    objective: str,
    min_distance: float | None,
    seed: int,
) -> None:
    """Find the least risky path of a lone agent: the guide that the swarm follows.

    Writes guide.csv (a row a step), candidates.csv (every start's outcome), paths.csv (other ways),
    guide.png and run.json; casswarm plot draws the folder again.
    The paper's projected gradient is set beside a global search: comparison.csv, comparison.png.

    With --joint, find the ways of all members that maximise the swarm's own success, and what no
    policy whatever can exceed: joint.csv (a row a step and member), outcomes.csv, joint.png and
    run.json. --time-limit is then that of the search: no further start is tried after it.

    \b
    Examples:
      casswarm plan paper-1
      casswarm plan paper-1 --search global --arrival any --gap 0.0001
      casswarm plan paper-1 --solver projected-gradient
      casswarm plan single-agent --map
      casswarm plan my-scenario.toml --set guide.a_max=0.3 --json
      casswarm plan paper-2 --joint --min-distance 0.1
    """
    _require_apt(joint)
    if solver == "projected-gradient" and (search, arrival, acceleration_limited) != (
        None,
        None,
        None,
    ):
        raise WrongInput(
            "the paper's projected gradient starts from the straight line, takes all the time and "
            "knows no a_max: --search, --arrival and --acceleration_limited do not apply to it"
        )
    with reported_errors():
        chosen = load(
            scenario,
            settings,
            guide__search=search,
            guide__arrival=arrival,
            guide__flyable=acceleration_limited,
        )
        from ..planning.plan import plan as find_guide

        if joint:
            plan_joint(
                chosen,
                Folder("plan-joint", chosen, out, figures, width=width, dpi=dpi),
                objective=objective,
                solver=solver,
                seed=seed,
                min_distance=min_distance,
                time_limit=time_limit if _given("time_limit") else None,
                as_json=as_json,
                quiet=quiet,
            )
            return
        folder = Folder("plan", chosen, out, figures, width=width, dpi=dpi)
        value = _value(chosen) if with_map else None  # first: it may need too many nodes
        guide = find_guide(
            chosen,
            solver,
            certify=certify,
            gap=gap,
            time_limit=time_limit,
            progress=lambda start: say(f"planning: {start}", quiet),
        )
        rival = _rival(chosen, guide) if solver == "projected-gradient" else None
        content = _write(folder, chosen, guide, rival, value, {"solver": solver})
    click.echo(json_text(content) if as_json else _words(chosen, guide, rival))
    say(folder.closing(), quiet)


_LONE = {"certify": "--no-certify", "gap": "--gap", "with_map": "--map"}
_JOINT = {"objective": "--objective", "min_distance": "--min-distance", "seed": "--seed"}


def _require_apt(joint: bool) -> None:
    """Refuse options of the guide's proof with --joint, and those of the joint plan without."""
    wrong = [word for name, word in (_LONE if joint else _JOINT).items() if _given(name)]
    if wrong and joint:
        raise WrongInput(f"{', '.join(wrong)}: of the guide alone, not of --joint")
    if wrong:
        raise WrongInput(f"{', '.join(wrong)}: of the joint plan alone, give --joint too")


def _given(name: str) -> bool:
    """Whether an option was given on the command line."""
    source = click.get_current_context().get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _rival(scenario: Scenario, guide: Guide) -> Guide:
    """A global search for what the paper's form asks for: no a_max, no margin, any arrival."""
    from dataclasses import replace

    from ..planning.plan import plan as find_guide

    free = {
        "acceleration_limited": False,
        "margin": 1e-6 * scenario.target.radius,
        "arrival": "any",
    }
    wanted = scenario.with_values({f"guide.{key}": value for key, value in free.items()})
    found = find_guide(wanted, search="global", certify=False)
    return replace(found, risk_bound=guide.risk_bound, certificate=guide.certificate)


def _value(scenario: Scenario) -> ValueFunction:
    from ..planning.bounds.value_function import ValueFunction

    return ValueFunction.of(scenario)


def _write(
    folder: Folder,
    scenario: Scenario,
    guide: Guide,
    rival: Guide | None,
    value: ValueFunction | None,
    inputs: dict[str, object],
) -> dict[str, object]:
    from ..planning.guide import integrate
    from ..results.catalogue import plan_figures
    from ..studies.tables import candidate_table, guide_table, path_table, rival_table

    folder.table("guide", guide_table(guide))
    folder.table("candidates", candidate_table(guide))
    ways = {
        f"{way.sides or 'way'} {number}": integrate(guide.positions[0], way.velocities, guide.dt)
        for number, way in enumerate(guide.ways())
    }
    rivals = {} if rival is None else {"projected gradient": guide, "global search": rival}
    paths = {"way": ways, "rival": {name: found.positions for name, found in rivals.items()}}
    folder.table("paths", path_table(paths))
    if rivals:
        folder.table("comparison", rival_table(rivals))
    outlook = None if value is None else _outlook(scenario, guide, value)
    if outlook is not None:
        folder.arrays("cost-to-go", outlook.arrays())
    folder.draw(plan_figures(scenario, guide, list(ways.values()), rivals, outlook))
    certificate = guide.certificate
    result = {
        "risk": guide.risk,
        "survival": guide.survival,
        "risk_bound": guide.risk_bound,
        "gap": guide.gap,
        "certificate": None if certificate is None else certificate.as_dict(),
        "arrival_step": guide.arrival,
        "arrives": guide.arrives,
        "solution": guide.solution.as_row(),
        "candidates": [candidate.as_row() for candidate in guide.candidates],
        "positions": guide.positions,
        "velocities": guide.velocities,
    }
    return folder.record(result, inputs)


def _outlook(scenario: Scenario, guide: Guide, value: ValueFunction) -> CostToGoMap:
    from ..figures.base_map import extent
    from ..planning.bounds.outlook import CostToGoMap

    return CostToGoMap.of(value, *extent(scenario, [guide.positions, scenario.positions]))


def _words(scenario: Scenario, guide: Guide, rival: Guide | None) -> str:
    from collections import Counter

    outcomes = Counter(str(candidate.solution.status) for candidate in guide.candidates)
    told = ", ".join(f"{count} {status}" for status, count in outcomes.items())
    radars = len(scenario.hazard.radar_positions)
    lines = [
        f"{scenario.name}: {_counted(scenario.n, 'member')}, {_counted(radars, 'radar')}, "
        f"{scenario.n_steps} steps of {scenario.time.dt:g}",
        f"{guide}, risk {guide.risk:.4f}",
        *(_proof(guide) or _unproven(scenario)),
        f"{guide.solution}",
        f"solves: {told}",
        *_ways(guide),
    ]
    if rival is not None:
        lines.append(f"a global search without a_max and margin: {rival}, risk {rival.risk:.4f}")
    elif not guide.solution.status.success:
        lines.append("the solver did not converge: this is its best path, not a minimum")
    elif guide.search == "local" or scenario.guide.arrival == "horizon":
        lines.append("a local search: --search global --arrival any may find a better way")
    return "\n".join(lines)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _ways(guide: Guide) -> list[str]:
    """The best of every way around the radars that was found; nothing where there is one alone."""
    ways = guide.ways()
    if len(ways) < 2 or not ways[0].sides:
        return []
    tried = [candidate.sides for candidate in guide.candidates]
    lines = ["ways around the radars, by the side (L, R) on which each is passed:"]
    for way in ways[:_WAYS]:
        told = f"  {way.sides}  survival {math.exp(-way.risk):.4f}, risk {way.risk:.4f}"
        solves = _counted(tried.count(way.sides), "solve")
        lines.append(f"{told}, step {len(way.velocities)} ({solves})")
    if len(ways) > _WAYS:
        lines.append(f"  and {len(ways) - _WAYS} more in candidates.csv")
    return lines


def _unproven(scenario: Scenario) -> list[str]:
    """What is missing for a proof, where it is the user's to give."""
    start = scenario.guide_start
    if scenario.hazard.single_agent_lower_bound(start, start) is not None:
        return []
    return [
        "not certified: that needs a lower bound of your rates over boxes; give them a "
        "single_agent_lower_bound (docs: rates of your own)"
    ]


def _proof(guide: Guide) -> list[str]:
    """What the gap is made of."""
    certificate = guide.certificate
    if certificate is None or guide.gap is None:
        return []
    lines = [f"gap {100 * guide.gap:.2g} % of the risk"]
    if certificate.gap < 0.5 * guide.gap:
        limits = "what the limits of acceleration, margin and arrival step cost"
        other = "a better way that was not found" if guide.search == "global" else "a local search"
        lines[0] += (
            f", {100 * certificate.gap:.2g} % for the best path of the same speed, survival "
            f"{certificate.survival:.4f}: the rest is {limits}, or {other}"
        )
    if certificate.gap > 0.01:
        lines.append(f"the proof ended before a gap of 1 %: {certificate.reason}")
    return lines

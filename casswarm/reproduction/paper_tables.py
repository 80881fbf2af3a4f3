"""The paper's tables: what they say, and success exact, sampled, under readings, when perturbed."""

from __future__ import annotations

import io
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd

from .._util.settings import Accuracy
from ..chain.confidence import wilson
from ..chain.monte_carlo import RunTrajectory
from ..formation import ProjectedGradient
from ..guide import homotopy_signature
from ..guide.agent import guide_solver, initial_velocities
from ..guide.guide import Guide
from ..guide.plan import plan
from ..motion.step import Motion
from ..policies import NaivePolicy, Policy, make_policy, member_guides
from ..scenario import Scenario, load_scenario
from ..scenario.variations import value
from ..studies.evaluation import estimate, evaluate
from ..studies.simulation import PAPER_POLICIES, simulate
from ..typing import Interval, LeaderSelection

PAPER_SUCCESS = {"naive": 0.32, "constrained": 0.64, "leader": 0.68}
"""Table II: success probabilities in scenario I."""

PAPER_RUNS = 50
"""Number of simulations behind each of them (section V.B)."""


def paper_interval(policy: str) -> tuple[float, float]:
    """Wilson's 95 % interval of the paper's success probability of a policy."""
    return wilson(round(PAPER_SUCCESS[policy] * PAPER_RUNS), PAPER_RUNS)


def table_1(scenario: Scenario) -> pd.DataFrame:
    """Table I beside the values of a scenario.

    Columns: parameter, meaning, key (in the scenario file), paper, casswarm. The hazard parameters
    are those of `scenario`: a scenario with collisions has them all.
    """
    table = pd.read_csv(io.StringIO(_data("table_1.csv")))
    return table.assign(casswarm=[float(value(scenario, key)) for key in table["key"]])


def geometry(scenario: Scenario) -> pd.DataFrame:
    """Positions that the paper only shows as a picture: a row per member, radar or target."""
    rows = [("member", *position) for position in scenario.swarm.positions]
    rows += [("radar", *position) for position in scenario.hazard.radar_positions.tolist()]
    rows += [("target", *scenario.target.center)]
    return pd.DataFrame(rows, columns=["item", "x", "y"])


def interpretations() -> pd.DataFrame:
    """Errors and ambiguities of the paper: a row each, with casswarm's interpretation.

    Columns: location (section or equation), kind (error, omission, unit or geometry), paper,
    interpretation, to_follow_the_paper (how to follow the paper literally; empty if that is
    impossible or makes no difference).
    """
    return pd.DataFrame(tomllib.loads(_data("interpretations.toml"))["interpretation"])


def _data(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")


WIDTH = 1e-3
"""Width of the exact bounds of Table II."""

STATES, RUNS = 150_000, 2000
"""Elsewhere: states after which the residual mass is sampled, and runs that sample it."""

METHOD = ProjectedGradient.name
METHOD_STATES = 30_000
"""The paper's method, and its `STATES`: its solves cost a hundred times as much."""

Report = Callable[[str], None]
"""Receives the name of the current task."""

DIGITS = 6  # of probabilities in tables: more differ between processors


def table_2(
    scenario: Scenario, guide: Guide, runs: int = RUNS, seed: int = 0, tolerance: float = WIDTH
) -> pd.DataFrame:
    """Table II: the paper's, by the paper's method, and along `guide` with the default solver.

    The paper's method plans guides and formations by projected gradient, with the settings of Table
    I. Columns: policy; the paper's number and its Wilson interval (of 50 runs); the method's, of as
    many runs, with theirs; its success, method_low to method_high, with method_kind as in `beyond`
    (sampled by `runs`); the exact bounds along `guide`, no wider than `tolerance`; and whether the
    last two lie in the paper's interval.
    """
    own = plan(scenario, METHOD, certify=False)
    few = simulate(
        scenario, PAPER_POLICIES, PAPER_RUNS, seed, guide=own, solver=METHOD, save_trajectories=0
    ).summary
    rows = []
    for number, policy in enumerate(PAPER_POLICIES):
        low, high = paper_interval(policy)
        exact = evaluate(scenario, policy, tolerance, guide=guide).success
        method, kind, _ = success_of(scenario, policy, own, solver=METHOD, runs=runs, seed=seed)
        rows.append(
            {
                "policy": policy,
                "paper": PAPER_SUCCESS[policy],
                "paper_low": low,
                "paper_high": high,
                **{
                    f"runs_{PAPER_RUNS}{end}": few.loc[number, f"success{end}"]
                    for end in ("", "_low", "_high")
                },
                "method_low": method.low,
                "method_high": method.high,
                "method_kind": kind,
                "exact_low": exact.low,
                "exact_high": exact.high,
                "method_within": low <= method.low and method.high <= high,
                "exact_within": low <= exact.low and exact.high <= high,
            }
        )
    return pd.DataFrame(rows).round(DIGITS)


def success_of(
    scenario: Scenario,
    policy: str,
    guide: Guide,
    *,
    solver: str = "auto",
    states: int | None = None,
    runs: int = RUNS,
    seed: int = 0,
) -> tuple[Interval, str, float]:
    """Success, its kind, and the mean number of infeasible member-steps (of the enumerated part).

    The kind is "proven" if the bounds are exact and at most `WIDTH` wide after `states` states,
    else "95 %": an interval, because the residual mass was sampled by `runs` runs. By default
    there are `STATES`, or `METHOD_STATES`.
    """
    states = states or (METHOD_STATES if solver == METHOD else STATES)
    part = evaluate(scenario, policy, WIDTH, max_states=states, guide=guide, solver=solver)
    if part.complete:
        return part.success, "proven", part.infeasible
    planned: dict[str, Any] = {"guide": guide, "solver": solver}
    fewer = Accuracy(max_states=states // 15, tolerance=1e-4)
    sampled = estimate(scenario, policy, runs, seed, accuracy=fewer, **planned)
    return sampled.success, "95 %", sampled.enumerated.infeasible


def variants() -> dict[str, tuple[Scenario, str]]:
    """Scenarios beyond the paper's, and the solvers of their formations, by their titles."""
    first, second = load_scenario("paper-1"), load_scenario("paper-2")
    best = {"guide.search": "global", "guide.arrival": "any"}
    alley = load_scenario("alley")
    collisions = {
        "hazard.kind": "saturation+collision",
        "hazard.beta_1": 0.2,
        "hazard.beta_2": 6.0,
    }
    scenarios = {
        "I: the paper's, local guide": first,
        "I: global guide": first.with_values(best),
        "I: alley": alley,
        "I: wall": load_scenario("wall"),
        "I: ring": load_scenario("ring"),
        "II: the paper's, local guide": second,
        "II: global guide": second.with_values(best),
        "II: alley": alley.with_values(collisions),
    }
    method = {"II: the paper's method": (second, METHOD)}
    return {title: (scenario, "auto") for title, scenario in scenarios.items()} | method


def beyond(
    scenarios: Mapping[str, tuple[Scenario, str]],
    report: Report,
    *,
    states: int | None = None,
    runs: int = RUNS,
    seed: int = 0,
) -> pd.DataFrame:
    """Success of the paper's policies in `variants`, a row per scenario and policy.

    The guides of "auto" are Ipopt's, those of the projected gradient its own. Columns: scenario;
    policy; the guide's arrival step, survival and homotopy signature;
    success_low, success_high, kind and infeasible as in `success_of`.
    """
    rows = []
    for name, (scenario, solver) in scenarios.items():
        report(name)
        guide = plan(scenario, guide_solver(solver), certify=False)
        homotopy = homotopy_signature(guide.positions, scenario.hazard.radar_positions)
        for policy in PAPER_POLICIES:
            success, kind, infeasible = success_of(
                scenario, policy, guide, solver=solver, states=states, runs=runs, seed=seed
            )
            rows.append(
                {
                    "scenario": name,
                    "policy": policy,
                    "arrival": guide.arrival,
                    "guide_survival": guide.survival,
                    "homotopy": homotopy,
                    "success_low": success.low,
                    "success_high": success.high,
                    "kind": kind,
                    "infeasible": round(infeasible, 2),
                }
            )
    return pd.DataFrame(rows).round(DIGITS)


READING_RUNS = 200
"""Runs per policy for every reading."""


@dataclass(frozen=True)
class Reading:
    """A question that the paper leaves open, and an answer to it.

    Parameters
    ----------
    location : str
        Section or equation of the paper.
    question, answer : str
    values : mapping
        Keys of the scenario that differ.
    guide_options, formation_options : mapping
        Options of the projected gradient that differ, for guides and for formations.
    leader_selection : str
        As `make_policy` takes it.
    lag : int
        Steps by which formations are behind the guide.
    """

    location: str
    question: str
    answer: str
    values: Mapping[str, Any] = field(default_factory=dict)
    guide_options: Mapping[str, Any] = field(default_factory=dict)
    formation_options: Mapping[str, Any] = field(default_factory=dict)
    leader_selection: LeaderSelection = "nearest"
    lag: int = 0


VELOCITY = {"x_scale": 1.0}  # steps in velocities instead of displacements
_STEP = "variable of the gradient steps"
_LEADER = "next leader"
READINGS = (
    Reading("all", "-", "as casswarm reads it"),
    Reading("III.A, IV.A", _STEP, "velocity, for all", {}, VELOCITY, VELOCITY),
    Reading("III.A", _STEP, "velocity, for guides only", {}, VELOCITY),
    Reading("IV.A", _STEP, "velocity, for formations only", {}, {}, VELOCITY),
    Reading("III.A", "gamma", "1", {"guide.gamma": 1.0}),
    Reading("III.A", "gamma", "100", {"guide.gamma": 100.0}),
    Reading("III.A", "iterate that is the guide", "the last", guide_options={"keep": "last"}),
    Reading("IV.A", "first iterate", "V(t-1), not 0", {}, {}, {"start": "x0"}),
    Reading("(5)", "V(-1)", "0", {"swarm.velocity": [0.0, 0.0]}),
    Reading("(5)-(7)", "point of the guide", "X*(t), not X*(t+1)", lag=1),
    Reading("IV.B.1", _LEADER, "first alive", leader_selection="first"),
    Reading("IV.B.1", _LEADER, "safest", leader_selection="safest"),
    Reading("II.B", "dt in survival", "exp(-lambda)", {"hazard.alpha_1": 4.0 / 0.33}),
    Reading("II.B", "length of a step", "1, ten steps", {"time.dt": 1.0}),
)
"""Answers to the paper's open questions; the first is casswarm's, the others change one each."""


def table_2_of_reading(
    scenario: Scenario, reading: Reading = READINGS[0], runs: int = READING_RUNS, seed: int = 0
) -> dict[str, Any]:
    """Table II by the paper's method under a reading.

    Keys: guide_arrival and guide_survival (0 if the guide does not arrive); per policy its success
    and the ends ``_low`` and ``_high`` of its Wilson interval of `runs` runs (absent if the guide
    does not arrive); within: how many of the policies are in the paper's intervals.
    """
    moved = scenario.with_values(reading.values)
    guide = plan(moved, METHOD, certify=False, check=False, solver_options=reading.guide_options)
    row = {"guide_arrival": guide.arrival, "guide_survival": guide.survival * guide.arrives}
    if not guide.arrives:
        return row | {"within": 0}
    if reading.lag:  # V(-1) stays that of the guide
        moved = moved.with_values({"swarm.velocity": guide.velocities[0].tolist()})
        guide = lagging(guide, reading.lag)
    own = member_guides(moved, guide, reading.guide_options)
    options: dict[str, Any] = {"solver_options": reading.formation_options}
    options["leader_selection"] = reading.leader_selection
    policies: list[Policy] = [NaivePolicy(Motion.from_scenario(moved), own)]
    policies += [make_policy(name, moved, guide, METHOD, **options) for name in PAPER_POLICIES[1:]]
    summary = simulate(moved, policies, runs, seed, guide=guide, save_trajectories=0).summary
    for name, (_, result) in zip(PAPER_POLICIES, summary.iterrows(), strict=True):
        row |= {f"{name}{end}": result[f"success{end}"] for end in ("", "_low", "_high")}
    return row | {"within": within(row)}


def lagging(guide: Guide, steps: int) -> Guide:
    """The guide, positions (T+1, 2), after a rest at its start: positions (T+1+steps, 2)."""
    rest = (steps, 0)
    return replace(
        guide,
        positions=np.pad(guide.positions, (rest, (0, 0)), mode="edge"),
        velocities=np.pad(guide.velocities, (rest, (0, 0))),
        rates=np.pad(guide.rates, rest, mode="edge"),
    )


def within(row: Mapping[str, Any]) -> int:
    """Number of the paper's policies whose success is in the paper's interval."""
    intervals = {name: paper_interval(name) for name in PAPER_POLICIES}
    return sum(low <= row[name] <= high for name, (low, high) in intervals.items())


def readings(
    scenario: Scenario,
    report: Report,
    seed: int = 0,
    runs: int = READING_RUNS,
    chosen: Sequence[Reading] = READINGS,
) -> pd.DataFrame:
    """Table II under each reading, by the paper's method.

    Columns: location, question, answer, and those of `table_2_of_reading`.
    """
    rows = []
    for reading in chosen:
        report(f"{reading.question}: {reading.answer}")
        asked = {name: getattr(reading, name) for name in ("location", "question", "answer")}
        rows.append(asked | table_2_of_reading(scenario, reading, runs, seed))
    return pd.DataFrame(rows).round(6)


SENSITIVITY_RUNS = 1000
"""Runs per policy and change by the paper's method."""

CALIBRATED = "as calibrated"
"""Name of the geometry without a change."""


def geometry_changes(scenario: Scenario) -> Iterator[tuple[str, dict[str, Any]]]:
    """Small changes of the calibrated geometry: names and values."""
    radars, center = scenario.hazard.radar_positions, np.array(scenario.target.center)
    gate = radars[0] - radars[-1]
    along = gate / np.hypot(*gate)
    for label, shift in (("wider", 0.05), ("narrower", -0.05)):
        moved = radars + np.outer([shift, *[0.0] * (len(radars) - 2), -shift], along)
        yield f"gate 0.1 {label}", {"hazard.radars": moved.tolist()}
    directions = {"right": (1, 0), "left": (-1, 0), "up": (0, 1), "down": (0, -1)}
    for name, direction in directions.items():
        moved = radars + 0.05 * np.array(direction)
        yield f"radars 0.05 {name}", {"hazard.radars": moved.tolist()}
    for label, factor in (("farther", 1.01), ("nearer", 0.99)):
        yield f"target 1 % {label}", {"target.center": (factor * center).tolist()}
    for label, factor in (("wider", 1.1), ("narrower", 0.9)):
        yield f"swarm 10 % {label}", {"swarm.positions": (factor * scenario.positions).tolist()}


def guide_changes(scenario: Scenario) -> Iterator[tuple[str, dict[str, Any]]]:
    """Small changes of what the paper's guide problem does not have: names and values."""
    for margin in (0.05, 0.1, 0.15, 0.3):
        yield f"guide.margin = {margin}", {"guide.margin": margin}
    for factor in (0.8, 1.25):
        a_max = round(factor * scenario.guide_a_max, 6)
        yield f"guide.a_max = {a_max:g}", {"guide.a_max": a_max}


def sensitivity(
    scenario: Scenario, report: Report, seed: int = 0, runs: int = SENSITIVITY_RUNS
) -> pd.DataFrame:
    """Table II after small changes: a row per solver and change.

    Columns: solver (the projected gradient, as in the paper, or ipopt), change, and those of
    `table_2_of_reading`. With the projected gradient: sampled by `runs` runs, with Wilson
    intervals. With Ipopt: midpoints of exact bounds, which are at most 0.01 wide.
    """
    same: list[tuple[str, dict[str, Any]]] = [(CALIBRATED, {})]
    geometries = [*same, *geometry_changes(scenario)]
    rows = []
    for name, change in geometries:
        report(f"{METHOD}: {name}")
        row = table_2_of_reading(scenario.with_values(change), runs=runs, seed=seed)
        rows.append({"solver": METHOD, "change": name, **row})
    for name, change in [*geometries, *guide_changes(scenario)]:
        report(f"ipopt: {name}")
        row = table_2_with_ipopt(scenario.with_values(change))
        rows.append({"solver": "ipopt", "change": name, **row})
    return pd.DataFrame(rows).round(4)


def table_2_with_ipopt(scenario: Scenario) -> dict[str, Any]:
    """Table II along Ipopt's guide, with exact bounds: the columns of `table_2_of_reading`."""
    guide = plan(scenario, certify=False)
    row: dict[str, Any] = {"guide_arrival": guide.arrival, "guide_survival": guide.survival}
    for policy in PAPER_POLICIES:
        success = evaluate(scenario, policy, 10 * WIDTH, guide=guide).success
        low, high = success
        row |= {policy: success.midpoint, f"{policy}_low": low, f"{policy}_high": high}
    return row | {"within": within(row)}


POLICIES = ("constrained", "leader")


def infeasible_steps(
    scenario: Scenario, guide: Guide, runs: int = 500, seed: int = 0
) -> pd.DataFrame:
    """Number of members with an empty constraint set at every step, in `runs` simulated runs.

    A row per policy and step: policy, step, runs (not yet ended), alive (their mean number of
    living members), infeasible (mean number of members whose constraint set is empty),
    any_infeasible (fraction of those runs with at least one).
    """
    study = simulate(scenario, POLICIES, runs, seed, guide=guide, save_trajectories=runs)
    rows = []
    for name in POLICIES:
        policy = make_policy(name, scenario, guide)
        for step in range(scenario.n_steps):
            active = [run for run in study.trajectories[name] if len(run.alive) > step + 1]
            if not active:
                break
            state = _states(scenario, guide, active, step)
            infeasible = policy.decide(step, *state).infeasible
            rows.append(
                {
                    "policy": name,
                    "step": step,
                    "runs": len(active),
                    "alive": float(state[2].sum(axis=1).mean()),
                    "infeasible": float(infeasible.mean()),
                    "any_infeasible": float((infeasible > 0).mean()),
                }
            )
    return pd.DataFrame(rows).round(4)


def _states(
    scenario: Scenario, guide: Guide, trajectories: Sequence[RunTrajectory], step: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, previous velocities and living members of the runs at a step."""
    positions = np.stack([trace.positions[step] for trace in trajectories])
    alive = np.stack([trace.alive[step] for trace in trajectories])
    if step == 0:
        previous_velocities = initial_velocities(scenario, guide)
    else:
        previous = np.stack([trace.positions[step - 1] for trace in trajectories])
        previous_velocities = (positions - previous) / scenario.time.dt
    lost = ~alive[..., None]
    return np.where(lost, 0.0, positions), np.where(lost, 0.0, previous_velocities), alive


def infeasibility_cost(scenario: Scenario, report: Report) -> pd.DataFrame:
    """Success with looser limits, along the same guide: what empty constraint sets cost.

    A row per change and policy: change, policy, success_low, success_high (proven), infeasible
    (mean number of infeasible member-steps per run).
    """
    guide = plan(scenario, certify=False)
    rows = []
    rho = scenario.formation.rho
    for factor, corridor in ((1, rho), (2, rho), (8, rho), (1, 0.1), (1, 0.2), (8, 0.2)):
        a_max = factor * scenario.swarm.a_max
        name = f"a_max = {a_max:g}, rho = {corridor:g}"
        report(f"empty sets: {name}")
        changed = scenario.with_values({"swarm.a_max": a_max, "formation.rho": corridor})
        for policy in POLICIES:
            distribution = evaluate(changed, policy, 5 * WIDTH, guide=guide)
            rows.append(
                {
                    "change": name,
                    "policy": policy,
                    "success_low": distribution.success.low,
                    "success_high": distribution.success.high,
                    "infeasible": round(distribution.infeasible, 3),
                }
            )
    return pd.DataFrame(rows).round(4)

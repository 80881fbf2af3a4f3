"""Which readings of the paper make its own results come out: Table II under each alternative."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from ..planning.guide import Guide
from ..planning.plan import plan
from ..policies import NaivePolicy, Policy, make_policy, member_guides
from ..problems.step import Motion
from ..scenario import Scenario
from ..studies.simulation import PAPER_POLICIES, simulate
from ..typing import LeaderSelection
from .paper import paper_interval
from .success import METHOD, Report

RUNS = 200
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
    scenario: Scenario, reading: Reading = READINGS[0], runs: int = RUNS, seed: int = 0
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
    policies: list[Policy] = [
        NaivePolicy(Motion.from_scenario(moved), member_guides(moved, guide, reading.guide_options))
    ]
    policies += [
        make_policy(
            name,
            moved,
            guide,
            METHOD,
            leader_selection=reading.leader_selection,
            solver_options=reading.formation_options,
        )
        for name in PAPER_POLICIES[1:]
    ]
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
    """How many of the paper's policies have a success in the paper's interval."""
    intervals = {name: paper_interval(name) for name in PAPER_POLICIES}
    return sum(low <= row[name] <= high for name, (low, high) in intervals.items())


def readings(
    scenario: Scenario,
    report: Report,
    seed: int = 0,
    runs: int = RUNS,
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

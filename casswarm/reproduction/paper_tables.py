"""Contents of the paper: its Table I and Table II, its errors and ambiguities."""

from __future__ import annotations

import io
import tomllib
from importlib.resources import files

import pandas as pd

from ..chain.confidence import wilson
from ..scenario import Scenario

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
    values = tomllib.loads(scenario.to_toml())

    def value(key: str) -> float:
        if key == "n":
            return float(scenario.n)
        table, _, name = key.partition(".")
        return float(values[table][name])

    table = pd.read_csv(io.StringIO(_data("table_1.csv")))
    return table.assign(casswarm=[value(key) for key in table["key"]])


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

"""Contents of the paper: its Table I and Table II, its errors and ambiguities."""

from __future__ import annotations

import tomllib
from importlib.resources import files

import pandas as pd

from ..scenario import Scenario

PAPER_SUCCESS = {"naive": 0.32, "constrained": 0.64, "leader": 0.68}
"""Table II: success probabilities in scenario I."""

PAPER_RUNS = 50
"""Number of simulations behind each of them (section V.B)."""

TABLE_1 = (
    ("n", "members", 5.0, "n"),
    ("V_max", "bound on each velocity component", 2.0, "swarm.v_max"),
    ("A_max", "bound on the squared change of velocity in a step", 0.5, "swarm.a_max"),
    ("t_f", "time at which a run ends", 10.0, "time.t_f"),
    ("delta t", "length of a step", 0.33, "time.dt"),
    ("alpha_1", "strength of the radars", 4.0, "hazard.alpha_1"),
    ("alpha_2", "weight of the density", 3.0, "hazard.alpha_2"),
    ("alpha_3", "range of the density", 4.0, "hazard.alpha_3"),
    ("beta_1", "range of collisions, scenario II", 0.2, "hazard.beta_1"),
    ("beta_2", "steepness of collisions, scenario II", 6.0, "hazard.beta_2"),
    ("learning rate, guide", "step of the projected gradient", 0.05, "guide.learning_rate"),
    ("epochs, guide", "iterations of the projected gradient", 6000.0, "guide.iterations"),
    ("learning rate, formation", "step of the projected gradient", 0.05, "formation.learning_rate"),
    ("iterations, formation", "of the projected gradient", 2000.0, "formation.iterations"),
    ("rho", "bound on the squared distance to the guide", 0.05, "formation.rho"),
)
"""Symbol, meaning, the paper's value, and the key of the scenario file."""


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

    return pd.DataFrame(
        [
            {
                "parameter": symbol,
                "meaning": meaning,
                "key": key,
                "paper": paper,
                "casswarm": value(key),
            }
            for symbol, meaning, paper, key in TABLE_1
        ]
    )


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
    text = (files(__package__) / "interpretations.toml").read_text(encoding="utf-8")
    return pd.DataFrame(tomllib.loads(text)["interpretation"])

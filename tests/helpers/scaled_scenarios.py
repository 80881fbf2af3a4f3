"""Scenarios in other units of length and time: the same model, other numbers."""

from __future__ import annotations

import tomllib

import numpy as np

from casswarm import Scenario

UNITS = {
    "swarm.positions": (1, 0),
    "swarm.velocity": (1, -1),
    "swarm.v_max": (1, -1),
    "swarm.a_max": (2, -2),
    "target.center": (1, 0),
    "target.radius": (1, 0),
    "time.dt": (0, 1),
    "time.t_f": (0, 1),
    "hazard.radars": (1, 0),
    "hazard.core_radius": (1, 0),
    "hazard.alpha_1": (2, -1),
    "hazard.alpha_3": (-2, 0),
    "hazard.beta_1": (1, 0),
    "guide.a_max": (2, -2),
    "guide.margin": (1, 0),
    "guide.gamma": (-1, 0),
    "guide.learning_rate": (2, 0),
    "formation.rho": (2, 0),
    "formation.learning_rate": (2, 1),
}
"""Exponents of length and time in the unit of every key that has one."""


def scaled(scenario: Scenario, length: float = 1.0, time: float = 1.0) -> Scenario:
    """The scenario with all lengths and times multiplied by these factors."""
    data = tomllib.loads(scenario.to_toml())
    values = {}
    for key, (meters, seconds) in UNITS.items():
        table, name = key.split(".")
        value = data[table].get(name)
        if value is None or value == "guide":
            continue
        factor = length**meters * time**seconds
        if key == "hazard.beta_1":  # beta_1^beta_2 is a rate times length^beta_2
            factor *= time ** (-1 / data["hazard"]["beta_2"])
        values[key] = (factor * np.array(value)).tolist()
    return scenario.with_values(values)

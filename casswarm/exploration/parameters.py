"""Parameters of a scenario that a slider or a list changes, with their ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..scenario.validation import fields, subtable

if TYPE_CHECKING:
    from ..scenario import Scenario

FACTOR = 4.0
"""Ratio of the ends of a slider to the value that the session starts with."""

MAX_MEMBERS = 12
"""Largest number of members of a slider, unless the scenario has more."""

SLIDERS = (
    "n",
    "swarm.v_max",
    "swarm.a_max",
    "target.radius",
    "time.t_f",
    "hazard.alpha_1",
    "hazard.alpha_2",
    "hazard.alpha_3",
    "hazard.beta_1",
    "hazard.beta_2",
    "guide.a_max",
    "formation.rho",
)
CHOICES = {"guide.search": ("local", "global"), "guide.arrival": ("any", "horizon")}


@dataclass(frozen=True)
class Parameter:
    """A number with a slider, on a logarithmic scale unless it is whole.

    Parameters
    ----------
    key : str
        As in `casswarm.sweep`.
    low, high : float
    whole : bool
        Whether the values are whole numbers.
    description : str
    """

    key: str
    low: float
    high: float
    whole: bool
    description: str


def parameters(scenario: Scenario) -> list[Parameter]:
    """Parameters of the scenario that are numbers, with ranges around their values."""
    listed = []
    for key in SLIDERS:
        number = value(scenario, key)
        if key == "n":
            most = max(MAX_MEMBERS, scenario.n)
            listed.append(Parameter(key, 1, most, True, "Number of members."))
        elif number:  # neither missing nor 0, which has no range
            low, high = float(number) / FACTOR, float(number) * FACTOR
            listed.append(Parameter(key, low, high, False, _description(key)))
    return listed


def value(scenario: Scenario, key: str) -> Any:
    """Value of a parameter or a choice; None if the scenario has none."""
    if key == "n":
        return scenario.n
    table, _, leaf = key.partition(".")
    return getattr(scenario.hazard_table if table == "hazard" else getattr(scenario, table), leaf)


def _description(key: str) -> str:
    from ..scenario import Scenario

    table, _, leaf = key.partition(".")
    model = subtable(fields(Scenario)[table])
    assert model is not None
    return fields(model)[leaf].description or ""

"""Scenarios: the swarm, its target and its hazards; the files that hold them."""

from .hazards import HazardTable
from .model import Scenario
from .reading import builtin_scenarios, load_scenario, save_scenario
from .tables import FormationOptions, GuideOptions, Swarm, Target, Time

__all__ = [
    "FormationOptions",
    "GuideOptions",
    "HazardTable",
    "Scenario",
    "Swarm",
    "Target",
    "Time",
    "builtin_scenarios",
    "load_scenario",
    "save_scenario",
]

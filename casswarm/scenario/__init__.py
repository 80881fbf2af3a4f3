"""Scenarios: the swarm, its target and its hazards, and the files that describe them."""

from .hazard_table import HazardTable
from .model import Scenario
from .scenario_files import builtin_scenarios, load_scenario, save_scenario
from .sections import FormationOptions, GuideOptions, Success, Swarm, Target, Time

__all__ = [
    "FormationOptions",
    "GuideOptions",
    "HazardTable",
    "Scenario",
    "Success",
    "Swarm",
    "Target",
    "Time",
    "builtin_scenarios",
    "load_scenario",
    "save_scenario",
]

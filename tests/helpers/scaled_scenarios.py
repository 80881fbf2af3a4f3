"""Scenarios in other units of length and time: the same model, other numbers."""

from __future__ import annotations

import sys
from pathlib import Path

from casswarm import Scenario

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from _attack_scenarios import data_of, scale_length, scale_time


def scaled(scenario: Scenario, length: float = 1.0, time: float = 1.0) -> Scenario:
    """The scenario with all lengths and times multiplied by these factors."""
    return Scenario.from_data(scale_time(scale_length(data_of(scenario), length), time))

"""Figures: arrays and tables in, a matplotlib Figure out; nothing is shown or written."""

from .bars import success_chart
from .laws import arrival_chart, population_chart
from .maps import comparison_map, guide_map, risk_map, swarm_map
from .paper import (
    beyond_chart,
    convergence_chart,
    guides_map,
    sensitivity_chart,
    shortfall_chart,
    table_2_chart,
)
from .profiles import pair_chart, profile_chart, win_chart
from .style import save
from .sweeps import sweep_heat_map, sweep_lines

__all__ = [
    "arrival_chart",
    "beyond_chart",
    "comparison_map",
    "convergence_chart",
    "guide_map",
    "guides_map",
    "pair_chart",
    "population_chart",
    "profile_chart",
    "risk_map",
    "save",
    "sensitivity_chart",
    "shortfall_chart",
    "success_chart",
    "swarm_map",
    "sweep_heat_map",
    "sweep_lines",
    "table_2_chart",
    "win_chart",
]

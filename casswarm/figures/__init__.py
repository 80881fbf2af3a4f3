"""Figures: arrays and tables in, a matplotlib Figure out; nothing is shown or written."""

from .ahead import look_ahead_chart
from .bars import success_chart
from .laws import arrival_chart, population_chart
from .maps import comparison_map, guide_map, risk_map, swarm_map
from .profiles import pair_chart, profile_chart, win_chart
from .style import save
from .sweeps import sweep_heat_map, sweep_lines

__all__ = [
    "arrival_chart",
    "comparison_map",
    "guide_map",
    "look_ahead_chart",
    "pair_chart",
    "population_chart",
    "profile_chart",
    "risk_map",
    "save",
    "success_chart",
    "swarm_map",
    "sweep_heat_map",
    "sweep_lines",
    "win_chart",
]

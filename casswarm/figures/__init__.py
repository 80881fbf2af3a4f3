"""Figures: arrays and tables in, a matplotlib Figure out; nothing is shown or written."""

from .bars import success_chart
from .joint import joint_map
from .laws import arrival_chart, population_chart
from .maps import comparison_map, guide_map, risk_map, swarm_map
from .profiles import pair_chart, profile_chart, win_chart
from .style import save
from .sweeps import sweep_heat_map, sweep_lines

__all__ = [
    "arrival_chart",
    "comparison_map",
    "guide_map",
    "joint_map",
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

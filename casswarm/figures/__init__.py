"""Figures: arrays and tables in, a matplotlib Figure out; nothing is shown or written."""

from .bars import success_chart
from .laws import arrival_chart
from .maps import guide_map, swarm_map
from .profiles import pair_chart, profile_chart, win_chart
from .style import save

__all__ = [
    "arrival_chart",
    "guide_map",
    "pair_chart",
    "profile_chart",
    "save",
    "success_chart",
    "swarm_map",
    "win_chart",
]

from .animation import animate, player, save_gif
from .formations import formation_chart
from .image_files import (
    THEMES,
    band_chart,
    gap_chart,
    pair_chart,
    profile_chart,
    ranking_chart,
    save,
    theme,
    win_chart,
)
from .maps import comparison_map, cost_to_go_map, guide_map, joint_map, swarm_map
from .mixtures import mixture_map
from .paper import convergence_chart, infeasible_chart, sensitivity_chart, table_2_chart
from .success import (
    arrival_chart,
    difference_chart,
    information_chart,
    mpc_chart,
    population_chart,
    success_chart,
    survival_chart,
    sweep_heat_map,
    sweep_lines,
)

__all__ = [
    "THEMES",
    "animate",
    "arrival_chart",
    "band_chart",
    "comparison_map",
    "convergence_chart",
    "cost_to_go_map",
    "difference_chart",
    "formation_chart",
    "gap_chart",
    "guide_map",
    "infeasible_chart",
    "information_chart",
    "joint_map",
    "mixture_map",
    "mpc_chart",
    "pair_chart",
    "player",
    "population_chart",
    "profile_chart",
    "ranking_chart",
    "save",
    "save_gif",
    "sensitivity_chart",
    "success_chart",
    "survival_chart",
    "swarm_map",
    "sweep_heat_map",
    "sweep_lines",
    "table_2_chart",
    "theme",
    "win_chart",
]

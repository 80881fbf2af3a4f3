"""Charts of comparisons of solvers, which belong to `casswarm.comparison`."""

from ..comparison.charts import (
    band_chart,
    gap_chart,
    pair_chart,
    profile_chart,
    ranking_chart,
    win_chart,
)

__all__ = [
    "band_chart",
    "gap_chart",
    "pair_chart",
    "profile_chart",
    "ranking_chart",
    "win_chart",
]

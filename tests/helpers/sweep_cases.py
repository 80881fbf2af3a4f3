"""A small scenario and a grid of its parameters."""

from typing import Any

import casswarm as csw

SMALL = csw.load_scenario("paper-1").with_values(
    {
        "swarm.positions": [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]],
        "time.t_f": 2.0,
        "target.center": [2.0, 0.5],
        "hazard.alpha_1": 20.0,
    }
)
GRID: dict[str, Any] = {"hazard.alpha_1": [5.0, 20.0], "n": [1, 2, 3]}

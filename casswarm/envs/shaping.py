"""Potential-based shaping of rewards by the certified risk to go.

With w_t(x) the lower bound of the risk to go of a single agent (`casswarm.planning.bounds`), the
potential of a state is the probability that one of the living would arrive if each were alone and
met that risk:

    Phi(t, X, alive) = 1 - prod over living i of (1 - exp(-w_t(X_i))),    0 where the run has ended.

A step's reward becomes r + gamma Phi' - Phi. The sum of the discounted additions over a run is
-Phi(initial state), whatever the actions are, so that no optimal policy changes: Ng, Harada and
Russell, "Policy invariance under reward transformations: theory and application to reward shaping",
ICML 1999, theorem 1.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..errors import EnvError
from ..planning.bounds import PotentialFamily, Relaxation
from .shaping_kernels import RiskTable

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_NODES = 250_000
"""Largest number of nodes of the table over all steps: 2 MB, which caches hold."""


@lru_cache(maxsize=16)
def risk_table(scenario: Scenario) -> RiskTable:
    """Table of the risk to go of a scenario.

    Raises
    ------
    EnvError
        The hazard provides no bounds of its rates.
    """
    task = Relaxation.from_scenario(scenario)
    if not task.bounded:
        raise EnvError(
            f"shaping needs a hazard with lower bounds of its rates, which "
            f"{type(scenario.hazard).__name__} does not provide; Saturation and "
            "SaturationCollision do: use shaping=False"
        )
    potential = PotentialFamily(task, scenario.positions, MAX_NODES).potential()
    east, north = np.asarray(task.start) + potential.spacing * np.array(potential.low)
    return RiskTable(
        values=np.stack(potential.values),
        east=float(east),
        north=float(north),
        spacing=float(potential.spacing),
        slack=float(potential.slack),
    )

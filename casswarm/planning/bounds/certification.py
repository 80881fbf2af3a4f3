"""Certificates for the guides of a scenario."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...optimization.solvers import make_solver
from ...problems.guide import GuideTask
from ...typing import FloatArray
from ..guide import Candidate, Guide
from ..homotopy import best_homotopy_classes
from ..kinematics import integrate
from ..multistart import Multistart
from .grid import Relaxation
from .risk_bound import GAP, TIME_LIMIT, Certificate, arrival_multiplier, certify

if TYPE_CHECKING:
    from ...scenario import Scenario


def certify_guide(
    scenario: Scenario, guide: Guide, gap: float = GAP, time_limit: float = TIME_LIMIT
) -> Certificate | None:
    """Certificate for the guides of a scenario; None if its hazard provides no lower bounds.

    The bound is compared with the best known path without acceleration limits and margin: the
    guide itself, or what Ipopt reaches from the best homotopy classes.
    """
    hazard, start = scenario.hazard, scenario.guide_start
    if hazard.single_agent_lower_bound(start, start) is None:
        return None
    task = Relaxation.from_scenario(scenario)
    paths = [guide.positions]
    unlimited = np.isinf(scenario.guide_a_max) and scenario.swarm.velocity == "guide"
    if not (
        unlimited and guide.search == "global" and scenario.arrival_margin <= 1e-5 * task.radius
    ):
        paths += _relaxed_paths(scenario, task)
    risks = [task.dt * float(hazard.single_agent_rates(path[1:]).sum()) for path in paths]
    best = int(np.argmin(risks))
    multiplier = arrival_multiplier(task, paths[best])
    return certify(task, risks[best], multiplier, gap=gap, time_limit=time_limit)


def _relaxed_paths(scenario: Scenario, task: Relaxation) -> list[FloatArray]:
    """Locally best paths of the relaxation, in two homotopy classes and near their arrival steps.

    The grid is not that of `Multistart`, whose target is smaller by the margin.
    """
    free = replace(
        GuideTask.from_scenario(scenario, task.start), radius=scenario.target.radius, a_max=np.inf
    )
    multistart = Multistart(scenario, free, make_solver("ipopt"))
    candidates: list[Candidate] = []
    for path, shifts in zip(best_homotopy_classes(task, 2), ((-1, 0, 1), (0,)), strict=False):
        candidates += multistart.candidates_along(path, [path.arrival + shift for shift in shifts])
    return [integrate(task.start, c.velocities, task.dt) for c in candidates if np.isfinite(c.risk)]

"""Convergence of the paper's projected gradient on its two problems, in steps of two kinds.

The paper's variable is the displacement of a step. Steps in velocities are dt^2 as long, and are
shown for comparison.

With a fixed step the method has no memory: k iterations from iterate m give iterate m + k. The
solver itself is therefore restarted from its last iterate, and every iterate is verified like any
other answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd

from ..formation import ProjectedGradient
from ..formation.task import corridor_formation, leader_formation, nearest
from ..guide.agent import initial_velocities
from ..guide.guide import Guide
from ..motion.kinematics import integrate, resample
from ..motion.step import Motion, Step
from ..nlp.program import Instances, Nlp
from ..nlp.solution import BatchSolution
from ..policies import make_policy
from ..problems.guide import GuideTask, penalised_guide_instance, penalised_guide_nlp
from ..scenario import Scenario
from ..solvers import make_solver
from ..typing import FloatArray

POINTS = (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 3000, 4000, 5000, 6000)
"""Numbers of iterations at which iterates are verified."""


def step_kinds(scenario: Scenario) -> dict[str, float]:
    """Variables in which steps are taken, and `ProjectedGradient.x_scale` of each."""
    return {"displacement": 1.0 / scenario.time.dt, "velocity": 1.0}


def iterates(
    nlp: Nlp, instances: Instances, solver: ProjectedGradient, points: Sequence[int]
) -> Iterator[tuple[int, BatchSolution]]:
    """Yield numbers of iterations and the iterates of all instances after them."""
    found = replace(solver, max_iter=points[0]).solve_batch(nlp, instances)
    yield points[0], found
    for before, after in pairwise(points):
        further = replace(solver, max_iter=after - before, start="x0")
        found = further.solve_batch(nlp, instances.with_x0(found.x))
        yield after, found


def guide_convergence(scenario: Scenario, points: Sequence[int] = POINTS) -> pd.DataFrame:
    """Projected gradient on the paper's penalised guide problem, from the straight line.

    A row per kind of steps and number of iterations: steps (`step_kinds`), iteration, objective,
    residual (stationarity, recomputed), risk and survival of the path up to its arrival (missing if
    it does not arrive), and the distance of its last point from the target zone.
    """
    task = GuideTask.from_scenario(scenario, scenario.guide_start)
    task = replace(task, radius=scenario.target.radius)
    nlp = penalised_guide_nlp(scenario.hazard, scenario.n_steps)
    line = resample(np.stack([task.start, task.center]), scenario.n_steps, task.dt)
    instance = penalised_guide_instance(nlp, task, scenario.guide.gamma, line)
    up_to = [k for k in points if k <= scenario.guide.iterations]
    rows = []
    for steps, x_scale in step_kinds(scenario).items():
        solver = ProjectedGradient(scenario.guide.learning_rate, x_scale)
        for iteration, found in iterates(nlp, instance, solver, up_to):
            velocities = np.clip(nlp.variable("velocities", found.x[0]), -task.v_max, task.v_max)
            path = integrate(task.start, velocities, task.dt)
            risk = _risk(scenario, path)
            away = scenario.target.distances(path[-1:])[0] - scenario.target.radius
            rows.append(
                {
                    "steps": steps,
                    "iteration": iteration,
                    "objective": found.objective[0],
                    "residual": found.stationarity[0],
                    "risk": risk,
                    "survival": np.exp(-risk),
                    "distance": max(0.0, float(away)),
                }
            )
    return _rounded(pd.DataFrame(rows))


def _risk(scenario: Scenario, path: FloatArray) -> float:
    """Risk of a path up to its first arrival; NaN if it does not arrive."""
    inside = scenario.target.contains(path[1:])
    if not inside.any():
        return float("nan")
    rates = scenario.hazard.rates_along(path[1 : 2 + int(inside.argmax())])
    return float(scenario.time.dt * rates.sum())


def whole_swarm(scenario: Scenario, policy: str, guide: Guide) -> Step:
    """Formation problem data of all steps of the run in which no member is lost."""
    chosen = make_policy(policy, scenario, guide)
    positions = [scenario.positions]
    previous_velocities = [initial_velocities(scenario, guide)]
    alive = np.ones((1, scenario.n), bool)
    for step in range(guide.arrival - 1):
        velocities = chosen.decide(
            step, positions[-1][None], previous_velocities[-1][None], alive
        ).velocities[0]
        positions.append(positions[-1] + scenario.time.dt * velocities)
        previous_velocities.append(velocities)
    return Step(
        scenario.hazard,
        Motion.from_scenario(scenario),
        np.stack(positions),
        np.stack(previous_velocities),
        np.repeat(alive, guide.arrival, axis=0),
        guide.positions[None, 1:],
    )


def formation_convergence(
    scenario: Scenario, policy: str, guide: Guide, points: Sequence[int] = POINTS
) -> pd.DataFrame:
    """Projected gradient on the formation problems of the run in which no member is lost.

    It starts from zero, projected. A row per kind of steps, time step and number of iterations, of
    the time steps in which at least one member is free: steps (`step_kinds`), step, iteration,
    objective (a rate per unit time), best (of the default solver), gap ((objective - best) / best),
    residual (stationarity, recomputed, in units of the scenario), converged (whether the method had
    converged).
    """
    options, data = scenario.formation, whole_swarm(scenario, policy, guide)
    if policy == "leader":
        formation = leader_formation(data, nearest(data, guide.positions[:-1, None]))
    else:
        formation = corridor_formation(data, options.rho)
    numbers = np.flatnonzero(formation.free.any(axis=1))
    nlp, instances = formation.nlp, formation.instances[numbers]
    best = make_solver("auto").solve_batch(nlp, instances).objective
    up_to = [k for k in points if k <= options.iterations]
    tables = [
        pd.DataFrame(
            {
                "steps": steps,
                "step": numbers,
                "iteration": iteration,
                "objective": found.objective,
                "best": best,
                "gap": found.objective / best - 1.0,
                "residual": found.stationarity,
                "converged": found.success,
            }
        )
        for steps, x_scale in step_kinds(scenario).items()
        for iteration, found in iterates(
            nlp, instances, ProjectedGradient(options.learning_rate, x_scale, start="zero"), up_to
        )
    ]
    return _rounded(pd.concat(tables, ignore_index=True))


def condensed(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Summary of formation problems: a row per kind of problem and steps, and number of iterations.

    Columns: problems, steps, iteration, count, converged (how many had converged), and the median
    and largest gap and residual.
    """
    kinds = ["problems", "steps", "iteration"]
    steps = pd.concat(tables, names=["problems"]).groupby(kinds, sort=False)
    return _rounded(
        steps.agg(
            count=("gap", "size"),
            converged=("converged", "sum"),
            gap_median=("gap", "median"),
            gap_largest=("gap", "max"),
            residual_median=("residual", "median"),
            residual_largest=("residual", "max"),
        ).reset_index()
    )


def _rounded(table: pd.DataFrame) -> pd.DataFrame:
    """Round to four significant digits; values below 1e-9 are rounding errors and become zero."""
    numbers = table.select_dtypes(float)
    rounded = numbers.mask(numbers.abs() < 1e-9, 0.0).map(lambda value: float(f"{value:.4g}"))
    return table.assign(**{str(name): column for name, column in rounded.items()})

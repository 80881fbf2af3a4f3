"""A joint plan from trajectories that another method proposes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...problems.joint import JointForm
from ...problems.joint_instances import JointTask
from ...typing import FloatArray
from .distribution import PlanDistribution
from .plan import SwarmPlan
from .screening import InitialGuess, delayed, track
from .solve import JointProblem, first_arrivals, stage_solver

if TYPE_CHECKING:
    from ...scenario import Scenario

_ITERATIONS = 300


def alternative_plan(scenario: Scenario, plan: SwarmPlan, positions: FloatArray) -> SwarmPlan:
    """The better one of a plan for success and what a solve from other trajectories leads to.

    Parameters
    ----------
    scenario : Scenario
        Of few enough members for an exact distribution.
    plan : SwarmPlan
    positions : (T+1, n, 2)
        Trajectories to track as closely as the limits allow, to their ends.
    """
    task = JointTask.from_scenario(scenario, plan.initial_velocities)
    problem = JointProblem(scenario, task, JointForm(plan.n, task.steps, True, "success", False))
    goals = positions[1 + np.minimum(np.arange(task.steps), len(positions) - 2)]
    arrivals = first_arrivals(scenario, positions)
    arrivals = delayed(task, np.where(arrivals > 0, arrivals, task.steps)[None])[0]
    guess = InitialGuess("alternative", arrivals, track(task, goals))
    solver = stage_solver("auto", scenario.hazard, problem.form, _ITERATIONS)
    (outcome,) = problem.solve([guess], solver)
    outcomes = *plan.outcomes, outcome
    if outcome.value <= plan.value:
        return replace(plan, outcomes=outcomes)
    trajectories = problem.positions(outcome.velocities)
    return replace(
        plan,
        positions=trajectories,
        velocities=outcome.velocities,
        arrivals=first_arrivals(scenario, trajectories),
        value=outcome.value,
        distribution=PlanDistribution.from_positions(scenario, trajectories),
        solution=outcome.solution,
        outcomes=outcomes,
    )

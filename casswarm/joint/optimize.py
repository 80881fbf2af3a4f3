"""Joint plans of a scenario: by a search, or from trajectories that another method proposes."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import Unpack

from .._util.numbers import require_seed
from .._util.progress import reporter
from .._util.settings import Execution, SavedKeywords, given_values
from .._util.text import did_you_mean
from ..bounds.success_bound import success_bound
from ..errors import ScenarioError, SolverError
from ..guide.frame import Frame
from ..guide.guide import Guide
from ..guide.plan import initial_velocities, plan
from ..motion.kinematics import integrate
from ..problems.joint import OBJECTIVES, JointForm
from ..problems.joint_instances import JointTask
from ..scenario.scenario_files import require_scenario
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Objective
from .initial_guesses import INITIAL_GUESSES
from .likely_sets import MAX_MEMBERS, likely_sets
from .plan_distribution import PlanDistribution
from .screening import InitialGuess, delayed, track
from .search import JointSearch
from .solve import STAGED, JointProblem, first_arrivals, stage_solver
from .swarm_plan import SwarmPlan, least_distance

if TYPE_CHECKING:
    from ..scenario import Scenario


def plan_swarm(
    scenario: Scenario,
    objective: Objective = "success",
    solver: str | Solver = "auto",
    *,
    initial_guesses: Sequence[str] = INITIAL_GUESSES,
    seed: int = 0,
    min_distance: float | None = None,
    guide: Guide | None = None,
    certify: bool = True,
    solver_options: Mapping[str, Any] | None = None,
    execution: Execution | None = None,
    **plain: Unpack[SavedKeywords],
) -> SwarmPlan:
    """Trajectories of all members that maximise the swarm's own probability of success.

    Parameters
    ----------
    scenario : Scenario
    objective : {"success", "arrivals", "survivors"}
        The probability that some member arrives alive by t_f, or the mean number of living members
        in the target, or alive anywhere, when the run ends: at the first arrival. With
        ``"arrivals"`` members stay outside the target until the common arrival step.
    solver : str or Solver
        By default casswarm's own interior-point method with exact second derivatives for up to 8
        members, if the rates are made of kernels, and else Ipopt: with exact second derivatives for
        up to 6 members, and with a limited-memory Hessian beyond.
    initial_guesses : sequence of str
        Of ``"formations"`` along a single agent's homotopy classes, ``"own"`` paths of the members
        (for swarms of at most 10), and ``"perturbed"``: changes and perturbations of the best plan.
        Those with the least exact cost are optimised, and the best of them to the end.
    seed : int
        Of the random perturbations; everything else is deterministic.
    min_distance : float, optional
        Minimum distance of any two members at every step after the first.
    guide : Guide, optional
        Provides V(-1) if the scenario leaves that to the guide; planned from the scenario by
        default, so that every policy begins with the same velocity.
    certify : bool
        Whether to compute `SwarmPlan.bound`, which takes up to some seconds.
    solver_options : mapping, optional
        Options of the solver, if it is given by name, with which it runs in all stages of the
        search; without them, ``"auto"`` and ``"ipopt"`` have settings for each stage.
    execution, **plain
        Values of `Execution`, in this record or as plain keywords: `time_limit`, seconds after
        which no further solve starts (the result then depends on the machine), and `progress`,
        which is called before every solve.

    Returns
    -------
    SwarmPlan
        The best outcome of all starts by its exact value, whatever its solver's status, or by the
        mean field's with more than 10 members; among those that keep `min_distance`, if any do.
        Its `success` has proven bounds; with more than 62 members it is None.

        It is planned in a `Frame` that the scenario's geometry defines: scenarios that differ by
        quarter turns and mirrors about the origin, and by the order of members, have the same plan.

    Raises
    ------
    SolverError
        An unknown objective, kind of initial guess or solver.
    PlanningError
        No guide was found to provide V(-1).
    ScenarioError
        Members that are closer to each other than `min_distance` from the start.
    ValueError
        A distance or time limit out of range.
    TypeError
        A value that is given plainly and in a record, or is none of these.
    """
    require_scenario("plan_swarm", scenario)
    values = given_values("plan_swarm", execution, plain=plain, time_limit=None, progress=None)
    time_limit, progress = values
    started, seed, progress = time.perf_counter(), require_seed(seed), reporter(progress)
    _require_known(objective, initial_guesses)
    _require_distance(scenario, min_distance)
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {time_limit!r}; allowed: seconds above 0")
    guide = plan(scenario, certify=False) if guide is None else guide
    # before the search, whose result it could cost
    bound = success_bound(scenario) if certify else None
    velocities = initial_velocities(scenario, guide)
    frame = Frame.of_scenario(scenario, velocities[0])
    framed = frame.scenario_in(scenario)
    task = JointTask.from_scenario(framed, frame.members_to(velocities), min_distance or 0.0)
    if solver not in STAGED or solver_options:
        solver = make_solver(solver, **dict(solver_options or {}))
    deadline = math.inf if time_limit is None else started + time_limit
    search = JointSearch(framed, task, objective, solver, deadline, frame.reported(progress))
    found = search.run(initial_guesses, seed)
    best = found.in_scenario(frame)
    positions = integrate(scenario.positions, best.velocities, scenario.time.dt)
    exact, likely = search.problem.form.exact, None
    if not exact and scenario.n <= MAX_MEMBERS:
        likely = likely_sets(framed, search.problem.positions(found.velocities))
    return SwarmPlan(
        scenario=scenario.name,
        objective=objective,
        positions=positions,
        velocities=best.velocities,
        initial_velocities=velocities,
        motion=task.motion,
        arrivals=first_arrivals(scenario, positions),
        value=best.value,
        distribution=PlanDistribution.from_positions(scenario, positions) if exact else None,
        solution=best.solution,
        outcomes=tuple(outcome.in_scenario(frame) for outcome in search.outcomes),
        bound=bound,
        min_distance=min_distance,
        seconds=time.perf_counter() - started,
        likely=likely,
    )


def _require_known(objective: str, kinds: Sequence[str]) -> None:
    if objective not in OBJECTIVES:
        hint = did_you_mean(objective, OBJECTIVES)
        raise SolverError(f"objective {objective!r} is unknown{hint}", objective=objective)
    if isinstance(kinds, str) or not kinds:
        allowed = ", ".join(INITIAL_GUESSES)
        raise SolverError(
            f"initial_guesses = {kinds!r}; expected a list of {allowed}", initial_guesses=kinds
        )
    for kind in kinds:
        if kind not in INITIAL_GUESSES:
            hint = did_you_mean(kind, INITIAL_GUESSES)
            raise SolverError(f"initial guess {kind!r} is unknown{hint}", initial_guesses=kinds)


def _require_distance(scenario: Scenario, min_distance: float | None) -> None:
    if min_distance is None:
        return
    if not 0 < min_distance < math.inf:
        raise ValueError(
            f"min_distance = {min_distance!r}; allowed: a finite number above 0, or None"
        )
    least = least_distance(scenario.positions[None])
    if least < min_distance:
        raise ScenarioError(
            f"min_distance = {min_distance!r}, but members start {least:g} apart; "
            "choose a smaller distance, or other initial positions (swarm.positions)",
            min_distance=min_distance,
            least_distance=least,
        )


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

"""Random scenarios for joint plans, and the best of many random restarts of the same solver."""

from __future__ import annotations

import numpy as np

import casswarm as csw
from casswarm import Scenario, SwarmOutcome
from casswarm.joint import InitialGuess, JointProblem
from casswarm.joint.initial_guesses import track
from casswarm.joint.solve import stage_solver
from casswarm.motion.kinematics import remaining_distance
from casswarm.problems.joint import JointForm, JointTask
from casswarm.typing import FloatArray, IntArray

STEP = 0.66  # v_max dt
ITERATIONS = 200
WAVES = 3


def random_scenario(seed: int) -> Scenario:
    """Two to four members, one to seven radars near the straight line, eight to eighteen steps."""
    rng = np.random.default_rng(seed)
    n, steps = int(rng.integers(2, 5)), int(rng.integers(8, 19))
    angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 0.85) * steps * STEP
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-np.sin(angle), np.cos(angle)])
    target, count = distance * along, int(rng.integers(1, 8))
    radars: list[FloatArray] = []
    while len(radars) < count:
        share, offset = rng.uniform(0.1, 0.95), rng.normal(0, 0.3 * distance)
        radar = share * target + offset * across
        if min(np.hypot(*(radar - target)), np.hypot(*radar)) > 0.8:
            radars.append(radar)
    positions = rng.uniform(-0.5, 0.5, (n, 2))
    collisions = rng.random() >= 0.6
    hazard: dict[str, object] = {
        "kind": "saturation+collision" if collisions else "saturation",
        "radars": np.round(radars, 3).tolist(),
        "alpha_1": float(np.round(rng.uniform(0.5, 6), 2)),
        "alpha_2": 3.0,
        "alpha_3": 4.0,
    }
    if collisions:
        hazard |= {"beta_1": 0.2, "beta_2": 6.0}
    moving = rng.random() < 0.5
    velocity = "guide" if moving else (target / np.abs(target).max()).round(3).tolist()
    swarm = {
        "positions": np.round(positions, 3).tolist(),
        "velocity": velocity,
        "v_max": 2.0,
        "a_max": float(rng.choice([0.5, 1.0, 2.0])),
    }
    return Scenario.from_data(
        {
            "name": f"random-{seed}",
            "swarm": swarm,
            "target": {"center": np.round(target, 3).tolist(), "radius": 0.5},
            "time": {"dt": 0.33, "t_f": steps * 0.33},
            "hazard": hazard,
        }
    )


def random_restarts(
    scenario: Scenario, initial_velocities: FloatArray, count: int, seed: int
) -> float:
    """The best value of solves from `count` random guesses, each continued until it settles."""
    task = JointTask.from_scenario(scenario, initial_velocities)
    problem = JointProblem(scenario, task, JointForm(scenario.n, scenario.n_steps))
    rng = np.random.default_rng([seed, count])
    earliest = earliest_arrivals(task)
    return max(settled(problem, random_guess(task, earliest, rng)).value for _ in range(count))


def earliest_arrivals(task: JointTask) -> IntArray:
    """The first step (n,) by which v_max allows each member to arrive, 0 if there is none."""
    reach = np.arange(1, task.steps + 1)[:, None, None] * task.motion.dt * task.motion.v_max
    distance = remaining_distance(task.start, task.center, reach)
    feasible = distance <= task.radius - task.margin
    return np.where(feasible.any(axis=0), feasible.argmax(axis=0) + 1, 0)


def random_guess(task: JointTask, earliest: IntArray, rng: np.random.Generator) -> InitialGuess:
    """Straight lines to the target by a random step, with waves of all members and of each."""
    n = len(task.start)
    last = int(rng.integers(max(earliest.max(), 1), task.steps + 1))
    share = np.arange(1, last + 1)[:, None, None] / last
    line = task.start + (task.center - task.start) * share
    length = np.hypot(*(task.center - task.start.mean(axis=0)))
    waves = np.arange(1, WAVES + 1)[:, None, None]
    shared = 0.35 * rng.normal(size=(WAVES, 1, 2)) * length / waves
    own = rng.normal(size=(WAVES, n, 2)) * rng.choice([0.02, 0.1, 0.3]) * length / waves
    bumps = np.tensordot(np.sin(np.pi * share[:, 0] * waves[:, 0, 0]), shared + own, axes=1)
    return InitialGuess("random", np.where(earliest > 0, last, 0), track(task, line + bumps))


def settled(problem: JointProblem, guess: InitialGuess) -> SwarmOutcome:
    """The outcome from a guess, continued with the arrival steps that it reaches."""
    solver = stage_solver("ipopt", problem.scenario.hazard, problem.form, ITERATIONS)
    (outcome,) = problem.solve([guess], solver)
    for _ in range(3):
        guess = problem.restart(outcome)
        if np.array_equal(guess.arrivals, outcome.arrivals):
            return outcome
        (improved,) = problem.solve([guess], solver)
        if improved.value <= outcome.value:
            return outcome
        outcome = improved
    return outcome


def has_guide(scenario: Scenario) -> bool:
    """Whether a single agent reaches the target."""
    return csw.plan(scenario, certify=False, check=False).arrives

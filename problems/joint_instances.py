"""Instances of the joint plan's programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..optimization.problem import Instances, Nlp
from ..typing import BoolArray, FloatArray, IntArray
from .formation import Motion
from .guide import tightened
from .joint import JointForm
from .subsets import subsets

if TYPE_CHECKING:
    from ..scenario import Scenario


MARGIN = 1e-5
"""Margin of arrival relative to the target's radius, above what a solver's tolerance leaves."""


@dataclass(frozen=True, eq=False)
class JointTask:
    """Initial state, target and limits of the members of a swarm.

    Parameters
    ----------
    start, initial_velocities : (n, 2)
        X(0) and V(-1).
    center : (2,)
    radius, margin : float
        Of the target; members arrive at most ``radius - margin`` from its centre.
    motion : Motion
        Limits of the members' velocities, and dt.
    steps : int
        Number of steps until t_f.
    min_distance : float
        Between members at every step after the first; 0 for none.
    """

    start: FloatArray
    initial_velocities: FloatArray
    center: FloatArray
    radius: float
    margin: float
    motion: Motion
    steps: int
    min_distance: float = 0.0

    @classmethod
    def from_scenario(
        cls, scenario: Scenario, initial_velocities: FloatArray, min_distance: float = 0.0
    ) -> JointTask:
        """Task of a scenario's members with V(-1) = `initial_velocities` (n, 2)."""
        return cls(
            start=scenario.positions,
            initial_velocities=initial_velocities,
            center=np.asarray(scenario.target.center, float),
            radius=scenario.target.radius,
            margin=MARGIN * scenario.target.radius,
            motion=Motion.from_scenario(scenario),
            steps=scenario.n_steps,
            min_distance=min_distance,
        )


def joint_instance(
    nlp: Nlp, form: JointForm, task: JointTask, arrivals: IntArray, velocities: FloatArray
) -> Instances:
    """Instance with arrival steps `arrivals` (n,), 0 for none, and a guess of (T, n, 2) velocities.

    Members of a swarm that has arrived completely by step T stop there.
    """
    n, steps, motion = form.n, form.horizon, task.motion
    length = motion.dt * motion.v_max
    arriving = np.arange(1, steps + 1)[:, None] == arrivals  # (N, n)
    last = int(arrivals.max()) if arrivals.all() else task.steps
    moving = np.arange(steps) < last
    guess = np.zeros((steps, n, 2))
    guessed = min(len(velocities), last)
    guess[:guessed] = np.clip(velocities[:guessed] / motion.v_max, -1.0, 1.0)
    limit = np.where(moving[:, None], 1.0, 0.0) * np.ones(2 * n)
    origin = task.start.mean(axis=0)
    lower, upper = _constraint_bounds(nlp, form, task, arriving, moving)
    return Instances(
        x0=nlp.pack_variables(velocities=guess.reshape(steps, 2 * n)),
        p=nlp.pack_parameters(
            **(_terminal_parameters(form, arriving) if form.exact else {}),
            arrivals=arriving.astype(float),
            start=((task.start - origin) / length).reshape(1, -1),
            initial_velocities=(task.initial_velocities / motion.v_max).reshape(1, -1),
            center=((task.center - origin) / length)[None],
            origin=origin[None],
            length=[[length]],
            clock=[[motion.dt]],
        ),
        lbx=nlp.pack_variables(velocities=-limit),
        ubx=nlp.pack_variables(velocities=limit),
        lbg=nlp.pack_constraints(**lower),
        ubg=nlp.pack_constraints(**upper),
    )


def _constraint_bounds(
    nlp: Nlp, form: JointForm, task: JointTask, arriving: BoolArray, moving: BoolArray
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Bounds of the program's constraints by name; `arriving` (N, n) and `moving` (N,) by step."""
    n, steps, motion = form.n, form.horizon, task.motion
    length = motion.dt * motion.v_max
    squared = np.where(moving[:, None], motion.a_max / motion.v_max**2, np.inf) * np.ones(n)
    at_target = np.array([((task.radius - task.margin) / length) ** 2])
    lower = {
        "acceleration": np.full((steps, n), -np.inf),
        "arrival": np.full((n, 1), -np.inf),
    }
    upper = {
        "acceleration": tightened(squared),
        "arrival": tightened(at_target)[None] * np.ones((n, 1)),
    }
    if "outside" in nlp.constraints:
        under_way = arriving[::-1].cumsum(axis=0)[::-1] > arriving
        outside = ((task.radius + task.margin) / length) ** 2
        lower["outside"] = np.where(under_way, outside, -np.inf)
        upper["outside"] = np.full((steps, n), np.inf)
    if "separation" in nlp.constraints:
        pairs = n * (n - 1) // 2
        least = (task.min_distance / length) ** 2
        lower["separation"] = np.where(moving[:, None], least, -np.inf) * np.ones(pairs)
        upper["separation"] = np.full((steps, pairs), np.inf)
    return lower, upper


def _terminal_parameters(form: JointForm, arriving: BoolArray) -> dict[str, FloatArray]:
    """Indicators of continuing runs, terminal costs, (N, 2^n) each, and the last cost (1, 2^n)."""
    costs, ended = terminal_costs(form.objective, form.n, arriving)
    last = _fraction_lost(form.n) if form.objective == "survivors" else np.ones(2**form.n)
    return {
        "continues": (~ended).astype(float),
        "costs": np.where(ended, costs, 0.0),
        "last_cost": last[None],
    }


def terminal_costs(objective: str, n: int, inside: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Cost of a run that ends at step t with the set d alive, and whether it ends there.

    Parameters
    ----------
    objective : {"success", "arrivals", "survivors"}
    n : int
    inside : (N, n) bool
        Whether each member is in the target at steps 1..N.

    Returns
    -------
    costs, ended : (N, 2^n)
    """
    members = subsets(n).members
    arriving = inside.astype(float) @ members.T
    if objective == "success":
        costs = np.zeros_like(arriving)
    elif objective == "arrivals":
        costs = 1.0 - arriving / n
    else:
        costs = np.broadcast_to(_fraction_lost(n), arriving.shape)
    return np.asarray(costs, float), np.asarray(arriving > 0)


def _fraction_lost(n: int) -> FloatArray:
    return np.asarray(1.0 - subsets(n).members.mean(axis=1))

"""Instances of the joint plan's programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..motion.step import Motion
from ..nlp.program import Instances, Nlp
from ..typing import BoolArray, FloatArray, IntArray
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


def joint_instances(
    nlp: Nlp,
    form: JointForm,
    task: JointTask,
    arrivals: Sequence[IntArray],
    velocities: Sequence[FloatArray],
) -> Instances:
    """Instances with arrival steps (n,) each, 0 for none, and guesses of (T, n, 2) velocities.

    Members of a swarm that has arrived completely by step T stop there.
    """
    parts = [
        _instance(nlp, form, task, steps, guess)
        for steps, guess in zip(arrivals, velocities, strict=True)
    ]

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(part, name) for part in parts])

    return Instances(
        joined("x0"), joined("p"), joined("lbx"), joined("ubx"), joined("lbg"), joined("ubg")
    )


def _instance(
    nlp: Nlp, form: JointForm, task: JointTask, arrivals: IntArray, velocities: FloatArray
) -> Instances:
    n, steps, motion = form.n, form.horizon, task.motion
    length = motion.dt * motion.v_max
    arriving = np.arange(1, steps + 1)[:, None] == arrivals  # (N, n)
    last = int(arrivals.max()) if arrivals.all() else task.steps
    moving = np.arange(steps)[:, None] < last  # (N, 1)
    guess = np.zeros((steps, n, 2))
    guessed = min(len(velocities), last)
    guess[:guessed] = np.clip(velocities[:guessed] / motion.v_max, -1.0, 1.0)
    origin = task.start.mean(axis=0)
    terminal: dict[str, ArrayLike] = {}
    if form.exact:
        costs, ended, last_cost = terminal_costs(form.objective, n, arriving)
        terminal = {"continues": ~ended, "costs": costs, "last_cost": last_cost[None]}
    change = np.where(moving, motion.a_max / motion.v_max**2, np.inf)
    lower: dict[str, ArrayLike] = {"acceleration": -np.inf, "arrival": -np.inf}
    upper: dict[str, ArrayLike] = {
        "acceleration": tightened(change),
        "arrival": tightened(((task.radius - task.margin) / length) ** 2),
    }
    if form.outside:
        under_way = arriving[::-1].cumsum(axis=0)[::-1] > arriving
        outside = ((task.radius + task.margin) / length) ** 2
        lower["outside"], upper["outside"] = np.where(under_way, outside, -np.inf), np.inf
    if "separation" in nlp.constraints:
        least = (task.min_distance / length) ** 2
        lower["separation"], upper["separation"] = np.where(moving, least, -np.inf), np.inf
    return Instances(
        x0=nlp.pack_variables(velocities=guess.reshape(steps, 2 * n)),
        p=nlp.pack_parameters(
            **terminal,
            arrivals=arriving,
            start=((task.start - origin) / length).reshape(1, -1),
            initial_velocities=(task.initial_velocities / motion.v_max).reshape(1, -1),
            center=((task.center - origin) / length)[None],
            origin=origin[None],
            length=length,
            clock=motion.dt,
        ),
        lbx=nlp.pack_variables(velocities=np.where(moving, -1.0, 0.0)),
        ubx=nlp.pack_variables(velocities=np.where(moving, 1.0, 0.0)),
        lbg=nlp.pack_constraints(**lower),
        ubg=nlp.pack_constraints(**upper),
    )


def terminal_costs(
    objective: str, n: int, inside: BoolArray
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Costs of runs by the step at which they end and the set d that is alive then.

    Parameters
    ----------
    objective : {"success", "arrivals", "survivors"}
    n : int
    inside : (N, n) bool
        Whether each member is in the target at steps 1..N.

    Returns
    -------
    costs, ended : (N, 2^n)
        Costs of runs that end at a step by an arrival, and whether they do; 0 where they do not.
    last : (2^n,)
        Costs of runs that end after step N without an arrival.
    """
    members = subsets(n).members
    arriving = inside.astype(float) @ members.T
    lost = 1.0 - members.mean(axis=1)
    costs, last = np.zeros_like(arriving), np.ones(2**n)
    if objective == "arrivals":
        costs = 1.0 - arriving / n
    elif objective == "survivors":
        costs, last = np.broadcast_to(lost, arriving.shape), lost
    ended = arriving > 0
    return np.where(ended, costs, 0.0), ended, last

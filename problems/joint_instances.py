"""Instances of the joint plan's programs: what the members are to do, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..optimization.problem import Instances, Nlp
from ..typing import BoolArray, FloatArray, IntArray
from .guide import within
from .joint import JointForm
from .subsets import subsets


@dataclass(frozen=True, eq=False)
class JointTask:
    """What the members of a swarm are to do.

    Parameters
    ----------
    start, before : (n, 2)
        X(0) and V(-1).
    center : (2,)
    radius, margin : float
        Of the target; members arrive at most ``radius - margin`` from its centre.
    v_max, a_max, dt : float
    steps : int
        Left until t_f.
    distance : float
        Between members; 0 where none is asked for.
    """

    start: FloatArray
    before: FloatArray
    center: FloatArray
    radius: float
    margin: float
    v_max: float
    a_max: float
    dt: float
    steps: int
    distance: float = 0.0


def joint_instance(
    nlp: Nlp, form: JointForm, task: JointTask, arrivals: IntArray, velocities: FloatArray
) -> Instances:
    """Instance with arrival steps `arrivals` (n,), 0 for none, started from `velocities` (T, n, 2).

    Members of a swarm that all arrive at step T or before stop there.
    """
    n, steps = form.n, form.horizon
    length = task.dt * task.v_max
    at = np.arange(1, steps + 1)[:, None] == arrivals  # (N, n)
    last = int(arrivals.max()) if arrivals.all() else task.steps
    moving = np.arange(steps) < last
    guess = np.zeros((steps, n, 2))
    known = min(len(velocities), last)
    guess[:known] = np.clip(velocities[:known] / task.v_max, -1.0, 1.0)
    limit = np.where(moving[:, None], 1.0, 0.0) * np.ones(2 * n)
    origin = task.start.mean(axis=0)
    squared = np.where(moving[:, None], task.a_max / task.v_max**2, np.inf) * np.ones(n)
    arriving = np.array([((task.radius - task.margin) / length) ** 2])
    lower = {
        "acceleration": np.full((steps, n), -np.inf),
        "arrival": np.full((n, 1), -np.inf),
    }
    upper = {
        "acceleration": within(squared),
        "arrival": within(arriving)[None] * np.ones((n, 1)),
    }
    if "outside" in nlp.constraints:
        to_come = at[::-1].cumsum(axis=0)[::-1] > at
        lower["outside"] = np.where(to_come, ((task.radius + task.margin) / length) ** 2, -np.inf)
        upper["outside"] = np.full((steps, n), np.inf)
    if "apart" in nlp.constraints:
        pairs = n * (n - 1) // 2
        least = (task.distance / length) ** 2
        lower["apart"] = np.where(moving[:, None], least, -np.inf) * np.ones(pairs)
        upper["apart"] = np.full((steps, pairs), np.inf)
    return Instances(
        x0=nlp.pack_variables(velocities=guess.reshape(steps, 2 * n)),
        p=nlp.pack_parameters(
            **(_ends(form, at) if form.exact else {}),
            arrivals=at.astype(float),
            begin=((task.start - origin) / length).reshape(1, -1),
            before=(task.before / task.v_max).reshape(1, -1),
            center=((task.center - origin) / length)[None],
            origin=origin[None],
            length=[[length]],
            clock=[[task.dt]],
        ),
        lbx=nlp.pack_variables(velocities=-limit),
        ubx=nlp.pack_variables(velocities=limit),
        lbg=nlp.pack_constraints(**lower),
        ubg=nlp.pack_constraints(**upper),
    )


def _ends(form: JointForm, at: BoolArray) -> dict[str, FloatArray]:
    """Where runs go on and what their ends cost, (N, 2^n) each, and the rest's cost (1, 2^n)."""
    costs, ending = end_costs(form.objective, form.n, at)
    last = _share_lost(form.n) if form.objective == "survivors" else np.ones(2**form.n)
    return {
        "goes_on": (~ending).astype(float),
        "costs": np.where(ending, costs, 0.0),
        "last": last[None],
    }


def end_costs(objective: str, n: int, inside: BoolArray) -> tuple[FloatArray, BoolArray]:
    """What a run costs that ends at step t with d alive, and whether it ends there.

    Parameters
    ----------
    objective : {"success", "arrivals", "survivors"}
    n : int
    inside : (N, n) bool
        Who is in the target at steps 1..N.

    Returns
    -------
    costs, ending : (N, 2^n)
    """
    members = subsets(n).members
    arriving = inside.astype(float) @ members.T
    if objective == "success":
        costs = np.zeros_like(arriving)
    elif objective == "arrivals":
        costs = 1.0 - arriving / n
    else:
        costs = np.broadcast_to(_share_lost(n), arriving.shape)
    return np.asarray(costs, float), np.asarray(arriving > 0)


def _share_lost(n: int) -> FloatArray:
    return np.asarray(1.0 - subsets(n).members.mean(axis=1))

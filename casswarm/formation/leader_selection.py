"""Rules that select the leader for leader protection.

The paper says only that another leader can be chosen when the leader is destroyed. A rule depends
on the state, not on its history: a leader on the guide remains the nearest to it while it is alive.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import contiguous
from ..motion.step import Step
from ..typing import FloatArray

Rule = Callable[[Step, FloatArray], NDArray[np.intp]]

_TIE = 1e-6  # of rates, and of distances in v_max dt: a tie, in which the lower index leads


def nearest(step: Step, reference: FloatArray) -> NDArray[np.intp]:
    """The living member nearest to the guide's present point, ties by index.

    `reference` has one point, (2,), or one for every state, (B, 2) or (B, 1, 2).
    """
    from .state_kernels import nearest_living  # Numba takes a second to import

    batch, tie = len(step.alive), _TIE * step.motion.v_max * step.motion.dt
    points, leaders = np.empty((batch, 2)), np.empty(batch, np.intp)
    points[:] = reference.reshape(-1, 2)
    positions, alive = contiguous(step.positions), contiguous(step.alive)
    nearest_living(positions, alive, points, tie, leaders)
    return leaders


def first(step: Step, reference: FloatArray) -> NDArray[np.intp]:  # noqa: ARG001
    """The living member with the lowest index."""
    return np.asarray(np.argmax(step.alive, axis=1))


def safest(step: Step, reference: FloatArray) -> NDArray[np.intp]:  # noqa: ARG001
    """The living member with the lowest rate at its present position, ties by index."""
    rates = np.where(step.alive, step.hazard.rates(step.positions, step.alive), np.inf)
    return np.asarray(np.argmax(rates <= rates.min(axis=1, keepdims=True) * (1 + _TIE), axis=1))


LEADER_SELECTION: dict[str, Rule] = {"nearest": nearest, "first": first, "safest": safest}
"""Rules by name, as `make_policy` takes them in `leader_selection`."""

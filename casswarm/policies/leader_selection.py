"""Who leads: rules of succession for leader protection.

The paper says only that another leader can be chosen when the leader is destroyed. A rule looks at
a state, not at its history: the leader on the guide stays the nearest to it while it is alive.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..problems.formation import Step
from ..typing import FloatArray

Rule = Callable[[Step, FloatArray], NDArray[np.intp]]

_TIE = 1e-9  # distances closer than this are equal; the lower index leads


def nearest(step: Step, place: FloatArray) -> NDArray[np.intp]:
    """The living member nearest to the guide's present `place` (2,), ties by index."""
    away = step.positions - place
    distance = np.where(step.alive, np.hypot(away[..., 0], away[..., 1]), np.inf)
    return np.asarray(np.argmax(distance <= distance.min(axis=1, keepdims=True) + _TIE, axis=1))


def first(step: Step, place: FloatArray) -> NDArray[np.intp]:  # noqa: ARG001
    """The living member of the lowest index."""
    return np.asarray(np.argmax(step.alive, axis=1))


def safest(step: Step, place: FloatArray) -> NDArray[np.intp]:  # noqa: ARG001
    """The living member of the lowest rate where it stands, ties by index."""
    rates = np.where(step.alive, step.hazard.rates(step.positions, step.alive), np.inf)
    return np.asarray(np.argmax(rates <= rates.min(axis=1, keepdims=True) * (1 + _TIE), axis=1))


LEADER_SELECTION: dict[str, Rule] = {"nearest": nearest, "first": first, "safest": safest}
"""Rules by the name that `make_policy(..., succession=...)` takes."""

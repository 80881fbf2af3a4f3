"""Interface of policies: a decision for every state of a batch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..typing import BoolArray, FloatArray
from .decision import Decision, checked_decision, checked_state, policy_call


class Policy(ABC):
    """Base of policies, which are immutable, deterministic and picklable.

    A policy implements `decide_batch`, which takes B states at once from step to step + 1. In every
    state the entries of destroyed members are zero, and a policy must not depend on them. It should
    not depend on the other states of the batch either, so that results do not depend on batching.
    """

    name: str

    decision_tol: ClassVar[float] = 0.0
    """Accuracy of the velocities, in units of v_max; 0 where they are exact but for rounding.

    `casswarm.evaluate` does not distinguish positions that differ by less."""

    @abstractmethod
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Decide in a batch of states.

        Parameters
        ----------
        step : int
            t, from 0.
        positions, previous_velocities : (B, n, 2)
            X(t) and V(t-1).
        alive : (B, n) bool
        """

    def decide(
        self, step: int, positions: ArrayLike, previous_velocities: ArrayLike, alive: ArrayLike
    ) -> Decision:
        """Decide in one state, which is a batch of one, or in a batch of states; it may be empty.

        Parameters
        ----------
        step : int
            t, from 0.
        positions, previous_velocities : (n, 2) or (B, n, 2)
            X(t) and V(t-1); those of the destroyed do not matter, and may be NaN.
        alive : (n,) or (B, n) bool

        Raises
        ------
        PolicyError
            Shapes that do not fit; living members whose positions or velocities are not finite.
        PolicyCallError
            The policy is a user's and fails, or returns no `Decision`.
        """
        name = str(getattr(self, "name", type(self).__name__))
        state = checked_state(name, step, positions, previous_velocities, alive)
        if not len(state[0]):
            return Decision.plain(state[0])
        if is_own(self):
            return self.decide_batch(step, *state)
        with policy_call(name, step):
            decision = self.decide_batch(step, *state)
        return checked_decision(name, step, decision, state[2])

    def velocities(
        self, step: int, positions: ArrayLike, previous_velocities: ArrayLike, alive: ArrayLike
    ) -> FloatArray:
        """Velocities (n, 2) of one state, or (B, n, 2) of a batch; see `decide`."""
        velocities = self.decide(step, positions, previous_velocities, alive).velocities
        return velocities if np.ndim(positions) == 3 else np.asarray(velocities[0])

    def leaders(
        self,
        step: int,  # noqa: ARG002
        positions: FloatArray,  # noqa: ARG002
        previous_velocities: FloatArray,  # noqa: ARG002
        alive: BoolArray,
    ) -> NDArray[np.integer[Any]]:
        """Index (B,) of the leader in every state of a batch, for figures; -1 without a leader."""
        return np.full(len(alive), -1)


def is_own(policy: Policy) -> bool:
    """Whether casswarm defines the class of a policy."""
    return type(policy).__module__.partition(".")[0] == __package__.partition(".")[0]

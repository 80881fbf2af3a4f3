"""Interface of policies: a decision for every state of a batch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import PolicyError
from ..typing import BoolArray, FloatArray
from .decision import Decision, checked_decision, policy_call


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
        """Decide in one state, which is a batch of one, or in a batch of states.

        Parameters
        ----------
        step : int
            t, from 0.
        positions, previous_velocities : (n, 2) or (B, n, 2)
            X(t) and V(t-1).
        alive : (n,) or (B, n) bool

        Raises
        ------
        PolicyError
            Shapes that do not fit.
        PolicyCallError
            The policy is a user's and fails, or returns no `Decision`.
        """
        state = np.asarray(positions), np.asarray(previous_velocities), np.asarray(alive)
        shapes = [array.shape for array in state]
        expected = [shapes[0], shapes[0], shapes[0][:-1]]
        if len(shapes[0]) not in (2, 3) or shapes[0][-1] != 2 or shapes != expected:
            raise PolicyError(
                f"positions, previous_velocities and alive have shapes {shapes}; expected "
                "(n, 2), (n, 2), (n,), or (B, n, 2), (B, n, 2), (B, n)",
                policy=getattr(self, "name", None),
                step=step,
                shapes=shapes,
            )
        if state[0].ndim == 2:
            state = state[0][None], state[1][None], state[2][None]
        name = str(getattr(self, "name", type(self).__name__))
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

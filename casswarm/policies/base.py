"""Interface of policies: velocities for a batch of states, and a report of what went wrong."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import PolicyError
from ..typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Decision:
    """Velocities of a policy in a batch of B states.

    Parameters
    ----------
    velocities : (B, n, 2)
        V(t); those of the destroyed are ignored.
    infeasible : (B,) int
        Number of members whose soft constraint (the leader's position, the corridor) could not be
        met.
    failures : (B,) int
        1 where the solver failed and its result was replaced or repaired, else 0.
    fallbacks : (B,) int
        1 where a first solution was not good enough and Ipopt was called, else 0.
    """

    velocities: FloatArray
    infeasible: IntArray
    failures: IntArray
    fallbacks: IntArray

    @classmethod
    def plain(cls, velocities: FloatArray) -> Decision:
        """A decision with nothing to report."""
        zeros = np.zeros(len(velocities), np.int64)
        return cls(velocities, zeros, zeros, zeros)


class Policy(ABC):
    """Base of policies, which are immutable, deterministic and picklable.

    A policy implements `decide_batch`, which takes B states at once from step to step + 1. In every
    state the entries of destroyed members are zero, and a policy must not depend on them. It should
    not depend on the other states of the batch either, so that results do not depend on batching.
    """

    name: str

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
        return self.decide_batch(step, *state)

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


@dataclass(frozen=True)
class UserPolicy(Policy):
    """Policy from a user's function of (step, positions, previous_velocities, alive)."""

    function: Callable[[int, FloatArray, FloatArray, BoolArray], Any]
    name: str

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Call the function; see `checked_velocities` for the velocities that it may return."""
        velocities = self.function(step, positions, previous_velocities, alive)
        return Decision.plain(checked_velocities(self.name, step, velocities, alive))


def checked_velocities(name: str, step: int, velocities: ArrayLike, alive: BoolArray) -> FloatArray:
    """Copy of the velocities (B, n, 2) that the policy `name` returned, zero for the destroyed.

    Raises
    ------
    PolicyError
        Velocities of the wrong shape, or not finite for a living member.
    """
    checked = np.asarray(velocities, dtype=float)
    expected = (*alive.shape, 2)
    if checked.shape != expected:
        raise PolicyError(
            f"policy {name!r} returned velocities of shape {checked.shape} at step {step}; "
            f"expected {expected}: (states, members, 2)",
            policy=name,
            step=step,
            shape=checked.shape,
            expected=expected,
        )
    checked = np.where(alive[..., None], checked, 0.0)
    if not np.isfinite(checked).all():
        state, member = (int(index) for index in np.argwhere(~np.isfinite(checked))[0][:2])
        raise PolicyError(
            f"policy {name!r} returned the velocity {checked[state, member]} for member {member} "
            f"at step {step}; velocities must be finite",
            policy=name,
            step=step,
            state=state,
            member=member,
            velocity=checked[state, member],
        )
    return checked


def as_policy(policy: Any, name: str | None = None) -> Policy:
    """Policy from a `Policy`, an object with a method `velocities`, or a function.

    Parameters
    ----------
    policy : Policy, object or function
        The method or function takes (step, positions, previous_velocities, alive), of shapes
        (B, n, 2), (B, n, 2) and (B, n), and returns velocities (B, n, 2).
    name : str, optional
        Name in tables; by default that of the object, the function or the class.

    Raises
    ------
    PolicyError
        None of these, or a `Policy` without a name.
    """
    if isinstance(policy, type):
        raise PolicyError(f"{policy.__name__} is a class; pass an instance: {policy.__name__}()")
    if isinstance(policy, Policy):
        if not hasattr(policy, "name"):
            raise PolicyError(f"{policy!r} has no name; define one in its class: name = 'mine'")
        return policy
    function = getattr(policy, "velocities", policy)
    if not callable(function):
        raise PolicyError(
            f"{policy!r} is not a policy: expected a name, a function of (step, positions, "
            "previous_velocities, alive), or an object with such a method called velocities",
            policy=policy,
        )
    default = getattr(policy, "name", None) or getattr(policy, "__name__", type(policy).__name__)
    return UserPolicy(function, name or str(default))

"""What a policy is: velocities for a batch of states, and an account of what it could not do."""

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
    """What a policy does in a batch of B states.

    Parameters
    ----------
    velocities : (B, n, 2)
        V(t); those of the destroyed are ignored.
    infeasible : (B,) int
        How many members could not fulfil their wish (the leader's place, the corridor).
    failures : (B,) int
        1 where the solver failed and a fallback was taken, else 0.
    fallbacks : (B,) int
        1 where a first answer was not good enough and Ipopt was called, else 0.
    """

    velocities: FloatArray
    infeasible: IntArray
    failures: IntArray
    fallbacks: IntArray

    @classmethod
    def plain(cls, velocities: FloatArray) -> Decision:
        """A decision with nothing to report."""
        none = np.zeros(len(velocities), np.int64)
        return cls(velocities, none, none, none)


class Policy(ABC):
    """A policy, through one verb. Policies are immutable, deterministic and pickle.

    `decide` takes step -> step + 1, for B states at once. In every state the entries of destroyed
    members are zero: a policy must not depend on them. It should not depend on the other states
    of the batch either, so that results do not depend on batching.
    """

    name: str

    @abstractmethod
    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Velocities of step `step`, with what could not be done.

        Parameters
        ----------
        step : int
            t, from 0.
        positions, previous_velocities : (B, n, 2)
            X(t) and V(t-1).
        alive : (B, n) bool
        """

    def leaders(
        self,
        step: int,  # noqa: ARG002
        positions: FloatArray,  # noqa: ARG002
        previous_velocities: FloatArray,  # noqa: ARG002
        alive: BoolArray,
    ) -> NDArray[np.integer[Any]]:
        """Who leads in every state, (B,): what pictures mark; -1 where nobody does."""
        return np.full(len(alive), -1)

    def velocities(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> FloatArray:
        """Velocities (B, n, 2) alone; see `decide`."""
        if np.ndim(positions) != 3:
            raise PolicyError(
                f"positions have shape {np.shape(positions)}; expected a batch, (B, n, 2): "
                "for a single state give positions[None], previous[None], alive[None]"
            )
        return self.decide(step, positions, previous_velocities, alive).velocities


@dataclass(frozen=True)
class UserPolicy(Policy):
    """A policy from a user's function of (step, positions, previous, alive)."""

    function: Callable[[int, FloatArray, FloatArray, BoolArray], Any]
    name: str

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """The function's velocities; see `checked_velocities` for what they must be."""
        found = self.function(step, positions, previous_velocities, alive)
        return Decision.plain(checked_velocities(self.name, step, found, alive))


def checked_velocities(name: str, step: int, velocities: ArrayLike, alive: BoolArray) -> FloatArray:
    """What the policy `name` gave at a step, (B, n, 2): a copy, zero for the destroyed.

    Raises
    ------
    PolicyError
        Velocities of the wrong shape, or not finite for a living member.
    """
    found = np.asarray(velocities, dtype=float)
    if found.shape != (*alive.shape, 2):
        raise PolicyError(
            f"policy {name!r} returned velocities of shape {found.shape} at step {step}; "
            f"expected {(*alive.shape, 2)}: (states, members, 2)"
        )
    found = np.where(alive[..., None], found, 0.0)
    if not np.isfinite(found).all():
        state, member = np.argwhere(~np.isfinite(found))[0][:2]
        raise PolicyError(
            f"policy {name!r} returned the velocity {found[state, member]} for member {member} "
            f"at step {step}; velocities must be finite"
        )
    return found


def as_policy(policy: Any, name: str | None = None) -> Policy:
    """A policy of what a user wrote: a `Policy`, an object with `velocities`, or a function.

    Parameters
    ----------
    policy : Policy, object or function
        Of (step, positions, previous, alive), of shapes (B, n, 2), (B, n, 2) and (B, n); its
        velocities have shape (B, n, 2).
    name : str, optional
        What tables call it; by default the name it has.

    Raises
    ------
    PolicyError
        None of these, or a `Policy` without a name.
    """
    if isinstance(policy, type):
        raise PolicyError(f"{policy.__name__} is a class; give an instance: {policy.__name__}()")
    if isinstance(policy, Policy):
        if not hasattr(policy, "name"):
            raise PolicyError(f"{policy!r} has no name; give its class one: name = 'mine'")
        return policy
    function = getattr(policy, "velocities", policy)
    if not callable(function):
        raise PolicyError(
            f"{policy!r} is no policy: expected a name, a function of (step, positions, previous, "
            "alive), or an object with such a method called velocities"
        )
    default = getattr(policy, "name", None) or getattr(policy, "__name__", type(policy).__name__)
    return UserPolicy(function, name or str(default))

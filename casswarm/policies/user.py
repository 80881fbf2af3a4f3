"""Policies of users: functions and objects as policies, and a time limit of their calls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._util.user_code import limited_time
from ..errors import PolicyCallError, PolicyError
from ..typing import BoolArray, FloatArray
from .base import Policy
from .decision import Decision, checked_velocities, policy_call


@dataclass(frozen=True)
class UserPolicy(Policy):
    """Policy from a user's function of (step, positions, previous_velocities, alive)."""

    function: Callable[[int, FloatArray, FloatArray, BoolArray], Any]
    name: str

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Call the function; see `checked_velocities` for the velocities that it may return."""
        with policy_call(self.name, step):
            velocities = self.function(step, positions, previous_velocities, alive)
        return Decision.plain(checked_velocities(self.name, step, velocities, alive))


@dataclass(frozen=True)
class LimitedPolicy(Policy):
    """A policy whose calls may take a number of seconds; see `as_policy`."""

    policy: Policy
    name: str
    time_limit: float

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Decide as the policy, or raise PolicyCallError if it takes too long."""
        try:
            with limited_time(self.time_limit):
                return self.policy.decide(step, positions, previous_velocities, alive)
        except TimeoutError as error:
            raise PolicyCallError(
                f"policy {self.name!r} took longer than its time limit of {self.time_limit:g} s at "
                f"step {step}, for {len(alive)} states",
                policy=self.name,
                step=step,
                time_limit=self.time_limit,
            ) from error

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Leaders as of the policy."""
        return self.policy.leaders(step, positions, previous_velocities, alive)


def as_policy(policy: Any, name: str | None = None, time_limit: float | None = None) -> Policy:
    """Policy from a `Policy`, an object with a method `velocities`, or a function.

    Parameters
    ----------
    policy : Policy, object or function
        The method or function takes (step, positions, previous_velocities, alive), of shapes
        (B, n, 2), (B, n, 2) and (B, n), and returns velocities (B, n, 2).
    name : str, optional
        Name in tables; by default that of the object, the function or the class.
    time_limit : float, optional
        Seconds that a call may take, of all states of a batch; a longer one raises an error. A call
        is interrupted on the main thread of a process, as with ``workers=1`` and in worker
        processes; in other threads, such as Dask's, and on Windows the error comes when it ends.

    Raises
    ------
    PolicyError
        None of these, or a `Policy` without a name.
    ValueError
        A time limit that is not above 0.
    """
    if time_limit is not None:
        if not time_limit > 0:
            raise ValueError(f"time_limit = {time_limit!r}; allowed: seconds above 0")
        unlimited = as_policy(policy, name)
        return LimitedPolicy(unlimited, unlimited.name, float(time_limit))
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

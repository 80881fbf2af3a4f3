"""Interface of policies: decisions for every state of a batch, and what is wrong with them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from numbers import Integral
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._util.text import shown
from .._util.user_code import USER_ERRORS, failure_text
from ..errors import CasswarmError, PolicyCallError, PolicyError
from ..typing import BoolArray, FloatArray, IntArray, States

if TYPE_CHECKING:
    from ..guide.guide import Guide
    from ..scenario import Scenario

SOLVER_TOL = 2.0**-23
"""Accuracy of velocities that solve formation problems, in units of v_max: about 1e-7, to which the
default solver solves them."""


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


@contextmanager
def policy_call(name: str, step: int) -> Iterator[None]:
    """Raise a PolicyCallError for what a user's policy raises, with its name, step and line."""
    try:
        yield
    except CasswarmError:
        raise
    except USER_ERRORS as error:
        raise call_error(name, step, f"failed at step {step}: {failure_text(error)}") from error


def call_error(name: str, step: int, text: str, **values: Any) -> PolicyCallError:
    """Error of the policy `name` at a step, about `values`."""
    return PolicyCallError(f"policy {name!r} {text}", policy=name, step=step, **values)


def checked_state(
    name: str, step: int, positions: ArrayLike, velocities: ArrayLike, alive: ArrayLike
) -> States:
    """Positions and velocities (B, n, 2) and the living (B, n) of a state or a batch of states.

    PolicyError refuses shapes that do not fit, numbers of the living that are not finite, and steps
    that are no whole numbers from 0.
    """
    if not isinstance(step, Integral) or isinstance(step, bool) or step < 0:
        message = f"step = {shown(step)}; allowed: whole numbers from 0"
        raise PolicyError(message, key="step", value=step)
    x, v, living = np.asarray(positions, float), np.asarray(velocities, float), np.asarray(alive)
    shapes = [x.shape, v.shape, living.shape]
    if x.ndim not in (2, 3) or shapes != [x.shape, x.shape, x.shape[:-1]] or x.shape[-1] != 2:
        raise PolicyError(
            f"positions, previous_velocities and alive have shapes {shapes}; expected "
            "(n, 2), (n, 2), (n,), or (B, n, 2), (B, n, 2), (B, n)",
            policy=name,
            step=step,
            shapes=shapes,
        )
    if x.ndim == 2:
        x, v, living = x[None], v[None], living[None]
    living = living.astype(bool, copy=False)
    with np.errstate(all="ignore"):
        total = x.sum() + v.sum()
    if not math.isfinite(total):  # of destroyed members, it may be
        x, v = (np.where(living[..., None], array, 0.0) for array in (x, v))
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            raise PolicyError(
                f"positions or previous velocities of living members are not finite at step {step}",
                policy=name,
                step=step,
            )
    return x, v, living


def checked_decision(name: str, step: int, decision: Any, alive: BoolArray) -> Decision:
    """The decision that the policy `name` returned on states of living members (B, n).

    PolicyCallError refuses what is no `Decision`, or not one for all states.
    """
    if not isinstance(decision, Decision):
        text = "decide_batch must return a Decision, such as Decision.plain(velocities)"
        raise call_error(name, step, f"returned {_described(decision)} at step {step}; {text}")
    checked_velocities(name, step, decision.velocities, alive)
    for kind in ("infeasible", "failures", "fallbacks"):
        shape = np.shape(getattr(decision, kind))
        if shape != alive.shape[:1]:
            text = f"expected ({len(alive)},): a count for every state"
            raise call_error(
                name, step, f"returned {kind} of shape {shape} at step {step}; {text}", shape=shape
            )
    return decision


def checked_velocities(name: str, step: int, velocities: Any, alive: BoolArray) -> FloatArray:
    """Copy of the velocities (B, n, 2) that the policy `name` returned, zero for the destroyed.

    PolicyCallError refuses those that are not numbers, of the wrong shape, or not finite for a
    living member.
    """
    try:
        checked = np.asarray(velocities, dtype=float)
    except (TypeError, ValueError) as error:
        text = "expected an array of velocities (states, members, 2)"
        raise call_error(
            name, step, f"returned {_described(velocities)} at step {step}; {text}"
        ) from error
    expected = (*alive.shape, 2)
    if checked.shape != expected:
        text = f"returned velocities of shape {checked.shape} at step {step}; expected {expected}"
        raise call_error(
            name, step, f"{text}: (states, members, 2)", shape=checked.shape, expected=expected
        )
    checked = np.where(alive[..., None], checked, 0.0)
    if not np.isfinite(checked).all():
        state, member = (int(index) for index in np.argwhere(~np.isfinite(checked))[0][:2])
        velocity = checked[state, member]
        text = f"returned the velocity {velocity} for member {member} at step {step}"
        where = {"state": state, "member": member, "velocity": velocity}
        raise call_error(name, step, f"{text}; velocities must be finite", **where)
    return checked


def _described(value: object) -> str:
    return "None" if value is None else f"an object of type {type(value).__name__}"


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

    weighs_cases: ClassVar[bool] = False
    """Whether the policy depends on what survival tells about a hazard that is not known."""

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
            Shapes that do not fit; living members whose positions or velocities are not finite; a
            step that is no whole number from 0.
        PolicyCallError
            The policy is a user's and fails, or returns no `Decision`.
        """
        name = str(getattr(self, "name", type(self).__name__))
        step = step[()] if isinstance(step, np.ndarray) and not step.ndim else step
        state = checked_state(name, step, positions, previous_velocities, alive)
        if not len(state[0]):
            return Decision.plain(state[0])
        if is_own(self):
            return self.decide_batch(step, *state)
        with policy_call(name, step):
            decision = self.decide_batch(step, *state)
        return checked_decision(name, step, decision, state[2])

    def given(self, beliefs: IntArray) -> Policy:  # noqa: ARG002
        """The policy in B states in which the cases of the hazard have weights (B, K)."""
        return self

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
    """Return True if casswarm defines the class of a policy."""
    return type(policy).__module__.partition(".")[0] == __package__.partition(".")[0]


def require_guide_of(scenario: Scenario, guide: Guide) -> None:
    """Raise PolicyError for a guide to another target than the scenario's, or in other steps."""
    target, dt = scenario.target.center, scenario.time.dt
    if guide.dt != dt or tuple(guide.center) not in [d.center for d in scenario.target.discs]:
        raise PolicyError(
            f"this guide leads to {tuple(guide.center)} in steps of {guide.dt}, but the scenario "
            f"{scenario.name!r} has its target at {target} and dt {dt}: plan a guide for this "
            "scenario",
            scenario=scenario.name,
        )

"""Users' CasADi functions of a state and parameters, compiled for every step with derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .._util.threads import locked_cache
from .._util.user_code import USER_ERRORS, failure_text
from ..errors import PolicyCallError
from ..typing import BoolArray, Expr, FloatArray, IntArray
from .batch_function import BatchFunction


@dataclass(frozen=True, eq=False)
class StepFunction:
    """The function at a step.

    Parameters
    ----------
    used : (q,) int
        Parameters that it depends on.
    values : BatchFunction
        States (5n, B), parameters (q,) to velocities (2n, B).
    derivatives : BatchFunction
        States, parameters, seeds (2n, B) to derivatives (4n, B), (q, B).
    """

    used: IntArray
    values: BatchFunction
    derivatives: BatchFunction


@dataclass(frozen=True, eq=False)
class ByIdentity:
    """A user's function, which need not be hashable, as a key."""

    function: Callable[..., Expr]
    name: str

    def __hash__(self) -> int:
        return id(self.function)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ByIdentity):
            return NotImplemented
        return self.function is other.function and self.name == other.name


@locked_cache(maxsize=512)
def step_function(key: ByIdentity, n: int, size: int, step: int) -> StepFunction:
    """Compiled values and derivatives of a user's function at a step.

    Raises
    ------
    PolicyCallError
        It fails, or returns no expression of shape (n, 2).
    """
    name = key.name
    state, parameters = ca.MX.sym("state", 5 * n), ca.MX.sym("parameters", size)
    positions, previous = (ca.reshape(state[2 * n * k : 2 * n * (k + 1)], 2, n).T for k in (0, 1))
    try:
        returned = key.function(step, positions, previous, state[4 * n :], parameters)
        velocities: Any = ca.MX(returned)
    except USER_ERRORS as error:
        raise PolicyCallError(
            f"policy {name!r} failed at step {step} with CasADi arguments: {failure_text(error)}",
            policy=name,
            step=step,
        ) from error
    if velocities.shape != (n, 2):
        raise PolicyCallError(
            f"policy {name!r} returned shape {velocities.shape} at step {step}; expected ({n}, 2): "
            "a velocity for every member",
            policy=name,
            step=step,
        )
    column = ca.vec(velocities.T)
    used = np.flatnonzero(ca.which_depends(column, parameters, 1, False))
    chosen, seeds = ca.MX.sym("chosen", len(used)), ca.MX.sym("seeds", 2 * n)
    given = ca.MX(size, 1)
    given[used.tolist()] = chosen
    column = ca.Function("velocities", [state, parameters], [column])(state, given)
    to_state = ca.jtimes(column, state, seeds, True)[: 4 * n]
    to_chosen = ca.jtimes(column, chosen, seeds, True)
    return StepFunction(
        used,
        BatchFunction.of([state, chosen], [column]),
        BatchFunction.of([state, chosen, seeds], [to_state, to_chosen]),
    )


def state_columns(
    positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
) -> FloatArray:
    """States as columns (5n, B): positions and previous velocities member by member, the living."""
    batch = len(alive)
    parts = (positions, previous_velocities, alive)
    return np.concatenate([np.reshape(part, (batch, -1)) for part in parts], axis=1).T

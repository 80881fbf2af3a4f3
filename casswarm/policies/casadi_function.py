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
from ..typing import BoolArray, Expr, FloatArray, IntArray, States
from .batch_function import BatchFunction


@dataclass(frozen=True, eq=False)
class CasadiFunction:
    """A CasADi function; see `casswarm.policies.state_function.StateFunction`.

    Parameters
    ----------
    function : callable
        Takes (step, positions, previous_velocities, alive, parameters), expressions of shapes
        (n, 2), (n, 2), (n, 1) and (p, 1), and returns velocities (n, 2).
    name : str
    n : int
        Number of members.
    size : int
        Number of parameters.
    """

    function: Callable[..., Expr]
    name: str
    n: int
    size: int

    def __post_init__(self) -> None:
        _compiled(self, 0)

    def values(self, step: int, states: States, parameters: FloatArray) -> FloatArray:
        """Velocities (B, n, 2) in B states."""
        function = _compiled(self, step)
        (values,) = function.values(_columns(*states), parameters[function.used])
        return values.T.reshape(states[0].shape)

    def derivatives(
        self,
        step: int,
        states: States,
        parameters: FloatArray,
        seeds: FloatArray,
        weights: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products of seeds with the derivatives; see `ParametricPolicy.adjoint`."""
        function, batch = _compiled(self, step), len(weights)
        used = parameters[function.used]
        to_state, to_used = function.derivatives(
            _columns(*states), used, seeds.reshape(batch, -1).T
        )
        to_parameters = np.zeros_like(parameters)
        to_parameters[function.used] = to_used @ weights
        to_positions, to_previous = to_state.reshape(2, -1, batch)
        shape = seeds.shape
        return to_positions.T.reshape(shape), to_previous.T.reshape(shape), to_parameters


@dataclass(frozen=True, eq=False)
class _StepFunction:
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


@locked_cache(maxsize=512)
def _compiled(of: CasadiFunction, step: int) -> _StepFunction:
    """Compiled values and derivatives of a user's function at a step.

    Raises
    ------
    PolicyCallError
        It fails, or returns no expression of shape (n, 2).
    """
    name, n, size = of.name, of.n, of.size
    state, parameters = ca.MX.sym("state", 5 * n), ca.MX.sym("parameters", size)
    positions, previous = (ca.reshape(state[2 * n * k : 2 * n * (k + 1)], 2, n).T for k in (0, 1))
    try:
        returned = of.function(step, positions, previous, state[4 * n :], parameters)
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
    return _StepFunction(
        used,
        BatchFunction.of([state, chosen], [column]),
        BatchFunction.of([state, chosen, seeds], [to_state, to_chosen]),
    )


def _columns(
    positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
) -> FloatArray:
    """States as columns (5n, B): positions and previous velocities member by member, the living."""
    batch = len(alive)
    parts = (positions, previous_velocities, alive)
    return np.concatenate([np.reshape(part, (batch, -1)) for part in parts], axis=1).T

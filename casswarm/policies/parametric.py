"""Policies with parameters, given as CasADi functions, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .._util.text import counted
from ..errors import PolicyCallError, PolicyError
from ..problems.step import Motion
from ..typing import BoolArray, Expr, FloatArray
from .base import Policy
from .decision import Decision, checked_velocities
from .step_function import ByIdentity, StepFunction, state_columns, step_function

if TYPE_CHECKING:
    from ..scenario import Scenario


@dataclass(frozen=True, eq=False)
class ParametricPolicy(Policy):
    """A policy that is a CasADi function of the state and of parameters.

    Its velocities are the nearest ones to the function's that v_max and a_max allow. This
    projection is differentiable almost everywhere, so `casswarm.success_gradient` can differentiate
    the success with respect to the parameters.

    Parameters
    ----------
    function : callable
        ``function(step, positions, previous_velocities, alive, parameters)`` with the step t, an
        int from 0, and CasADi expressions: positions and previous velocities (n, 2), `alive`
        (n, 1), 1 for the living, and parameters (p, 1). It returns velocities (n, 2), in units of
        length per unit time. The entries of the destroyed are zero, and the function must not
        depend on them. It is called once for every step. Use squared distances rather than
        ``norm_2``, whose derivative at zero is NaN.
    parameters : array_like, shape (p,)
        Their values, finite.
    scenario : Scenario
        Whose number of members, v_max and a_max the policy has.
    name : str
        Name in tables.

    Raises
    ------
    PolicyError
        Parameters that are not a vector of finite numbers; a function that fails at step 0, or
        returns another shape.

    Examples
    --------
    Members head for the target at a speed that is to be learnt:

    >>> import casadi as ca
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("barricade")
    >>> def homing(step, positions, previous_velocities, alive, parameters):
    ...     center = ca.repmat(ca.DM(scenario.target.center).T, scenario.n, 1)
    ...     to_target = center - positions
    ...     distance = ca.sqrt(1e-6 + ca.sum2(to_target**2))
    ...     return parameters[0] * to_target / ca.repmat(distance, 1, 2)
    >>> policy = csw.ParametricPolicy(homing, [1.8], scenario)
    >>> velocities = policy.velocities(0, scenario.positions, 0 * scenario.positions, [True] * 5)
    >>> (velocities**2).sum(axis=1).round(3)  # at rest before, so a_max = 0.5 limits them
    array([0.5, 0.5, 0.5, 0.5, 0.5])
    """

    function: Callable[..., Expr]
    parameters: FloatArray
    scenario: Scenario
    name: str = "parametric"
    decision_tol: ClassVar[float] = 2.0**-36

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", checked_parameters(self.parameters))
        if not callable(self.function):
            raise PolicyError(
                f"{self.function!r} is not a function of (step, positions, previous_velocities, "
                "alive, parameters)"
            )
        self._step_function(0)

    def with_parameters(self, parameters: ArrayLike) -> ParametricPolicy:
        """The policy with other parameters (p,)."""
        values = checked_parameters(parameters)
        if values.shape != self.parameters.shape:
            raise PolicyError(
                f"policy {self.name!r} has {counted(self.parameters.size, 'parameter')}, not "
                f"{values.size}"
            )
        return replace(self, parameters=values)

    @cached_property
    def motion(self) -> Motion:
        """Limits of the members' motion."""
        return Motion.from_scenario(self.scenario)

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Evaluate the function and project its velocities; see `Policy.decide_batch`."""
        commanded = self.commanded(step, positions, previous_velocities, alive)
        return Decision.plain(self.motion.sets(previous_velocities).project(commanded))

    def commanded(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> FloatArray:
        """Velocities (B, n, 2) of the function in B states, not projected; 0 for the destroyed.

        Raises
        ------
        PolicyCallError
            They are not finite for a living member, or the function fails at this step.
        PolicyError
            The states have another number of members than the policy's scenario.
        """
        n = self.scenario.n
        if alive.shape[1] != n:
            raise PolicyError(f"policy {self.name!r} is for {n} members, not {alive.shape[1]}")
        function = self._step_function(step)
        columns = state_columns(positions, previous_velocities, alive)
        (values,) = function.values(columns, self.parameters[function.used])
        return checked_velocities(self.name, step, values.T.reshape(-1, n, 2), alive)

    def project_adjoint(
        self, step: int, states: tuple[FloatArray, FloatArray, BoolArray], seeds: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Products of seeds with the derivatives of the projection of `commanded`.

        Parameters
        ----------
        step, states, seeds
            As of `adjoint`, seeds being with respect to the projected velocities.

        Returns
        -------
        to_commanded, to_previous : (B, n, 2)
            Derivatives with respect to the commanded and the previous velocities.
        """
        commanded = self.commanded(step, *states)
        projected = self.motion.sets(states[1]).project(commanded)
        return self.motion.project_adjoint(commanded, states[1], projected, seeds)

    def adjoint(
        self,
        step: int,
        states: tuple[FloatArray, FloatArray, BoolArray],
        seeds: FloatArray,
        weights: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products of seeds with the derivatives of `commanded`.

        Parameters
        ----------
        step : int
        states : tuple
            Positions and previous velocities (B, n, 2), and the living (B, n).
        seeds : (B, n, 2)
            Derivatives of a number per state with respect to its commanded velocities.
        weights : (B,)

        Returns
        -------
        to_positions, to_previous : (B, n, 2)
            Derivatives of every state's number.
        to_parameters : (p,)
            Sum of the derivatives of all numbers, weighted by `weights`.

        Raises
        ------
        PolicyCallError
            A derivative is not finite.
        """
        function, shape = self._step_function(step), seeds.shape
        columns = state_columns(*states)
        seeds = np.where(states[2][..., None], seeds, 0.0).reshape(len(seeds), -1).T
        used = self.parameters[function.used]
        to_state, to_used = function.derivatives(columns, used, seeds)
        to_parameters = np.zeros_like(self.parameters)
        to_parameters[function.used] = to_used @ weights
        if not (np.isfinite(to_state).all() and np.isfinite(to_parameters).all()):
            raise PolicyCallError(
                f"policy {self.name!r} has a derivative at step {step} that is not finite; avoid "
                "roots and norms of numbers that can be zero, such as distances of the destroyed",
                policy=self.name,
                step=step,
            )
        to_positions, to_previous = to_state.reshape(2, -1, len(weights))
        return to_positions.T.reshape(shape), to_previous.T.reshape(shape), to_parameters

    def _step_function(self, step: int) -> StepFunction:
        function = ByIdentity(self.function, self.name)
        return step_function(function, self.scenario.n, self.parameters.size, step)


def checked_parameters(parameters: ArrayLike) -> FloatArray:
    """Parameters as a read-only vector (p,) of finite numbers.

    Raises
    ------
    PolicyError
    """
    try:
        values = np.array(parameters, dtype=float)
    except (TypeError, ValueError):
        raise PolicyError(f"parameters are {parameters!r}; expected a vector of numbers") from None
    if values.ndim != 1 or not values.size:
        raise PolicyError(f"parameters have shape {values.shape}; expected (p,), p >= 1")
    if not np.isfinite(values).all():
        raise PolicyError("parameters hold NaN or infinity")
    values.flags.writeable = False
    return values

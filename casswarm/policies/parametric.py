"""Policies with parameters, given as functions of CasADi, JAX or PyTorch, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .._util.text import counted
from ..errors import PolicyCallError, PolicyError
from ..motion.step import Motion
from ..typing import BoolArray, FloatArray, States
from .base import Decision, Policy, checked_velocities
from .functions import ByIdentity, StateFunction, state_function

if TYPE_CHECKING:
    from ..scenario import Scenario


@dataclass(frozen=True, eq=False)
class ParametricPolicy(Policy):
    """A policy that is a function of the state and of parameters, in CasADi, JAX or PyTorch.

    Its velocities are the nearest ones to the function's that v_max and a_max allow. This
    projection is differentiable almost everywhere, so `casswarm.success_gradient` can differentiate
    the success with respect to the parameters.

    Parameters
    ----------
    function : callable
        ``function(step, positions, previous_velocities, alive, parameters)``, which returns
        velocities (n, 2), in units of length per unit time. The step t is an int from 0, positions
        and previous velocities are (n, 2); the entries of the destroyed are zero, and the function
        must not depend on them. Use squared distances rather than norms, whose derivative at zero
        is NaN. The other arguments depend on the framework:

        - CasADi: expressions; `alive` (n, 1), 1 for the living, and parameters (p, 1). It is called
          once for every step.
        - JAX: traced arrays of double precision, whatever the global configuration is; `alive`
          (n,), booleans, and parameters (p,). The step is traced, too, so that one compilation
          serves all steps.
        - PyTorch: tensors of double precision on the default device; `alive` (n,), booleans, and
          parameters (p,). It is mapped over states by `torch.func.vmap`.
    parameters : array_like, shape (p,)
        Their values, finite.
    scenario : Scenario
        Whose number of members, v_max and a_max the policy has.
    name : str
        Name in tables.
    framework : {"casadi", "jax", "torch"}
        What the function is written in. JAX and PyTorch need packages of their own:
        ``pip install 'casswarm[jax]'`` or ``pip install 'casswarm[torch]'``.

    Raises
    ------
    PolicyError
        Parameters that are not a vector of finite numbers; an unknown framework; a function that
        fails at step 0, or returns another shape.
    ExtraError
        The framework's package is not installed.

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

    function: Callable[..., Any]
    parameters: FloatArray
    scenario: Scenario
    name: str = "parametric"
    framework: str = "casadi"
    decision_tol: ClassVar[float] = 2.0**-36

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", checked_parameters(self.parameters))
        if not callable(self.function):
            raise PolicyError(
                f"{self.function!r} is not a function of (step, positions, previous_velocities, "
                "alive, parameters)",
                key="function",
                value=repr(self.function),
            )
        self._state_function()

    def with_parameters(self, parameters: ArrayLike) -> ParametricPolicy:
        """The policy with other parameters (p,)."""
        values = checked_parameters(parameters)
        if values.shape != self.parameters.shape:
            raise PolicyError(
                f"policy {self.name!r} has {counted(self.parameters.size, 'parameter')}, not "
                f"{values.size}",
                policy=self.name,
                key="parameters",
                value=values.size,
                expected=self.parameters.size,
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
            raise PolicyError(
                f"policy {self.name!r} is for {n} members, not {alive.shape[1]}",
                policy=self.name,
                members=alive.shape[1],
                expected=n,
            )
        states = positions, previous_velocities, alive
        values = self._state_function().values(step, states, self.parameters)
        return checked_velocities(self.name, step, values, alive)

    def project_adjoint(
        self, step: int, states: States, seeds: FloatArray
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
        states: States,
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
        seeds = np.where(states[2][..., None], seeds, 0.0)
        derivatives = self._state_function().derivatives(
            step, states, self.parameters, seeds, weights
        )
        if not all(np.isfinite(part).all() for part in derivatives):
            raise PolicyCallError(
                f"policy {self.name!r} has a derivative at step {step} that is not finite; avoid "
                "roots and norms of numbers that can be zero, such as distances of the destroyed",
                policy=self.name,
                step=step,
            )
        return derivatives

    def _state_function(self) -> StateFunction:
        key = ByIdentity(self.function, self.name)
        return state_function(self.framework, key, self.scenario.n, self.parameters.size)


def checked_parameters(parameters: ArrayLike) -> FloatArray:
    """Parameters as a read-only vector (p,) of finite numbers.

    Raises
    ------
    PolicyError
    """
    try:
        values = np.asarray(parameters, dtype=float).copy()
    except (TypeError, ValueError):
        raise PolicyError(
            f"parameters are {parameters!r}; expected a vector of numbers",
            key="parameters",
            value=repr(parameters),
        ) from None
    if values.ndim != 1 or not values.size:
        raise PolicyError(
            f"parameters have shape {values.shape}; expected (p,), p >= 1",
            key="parameters",
            shape=values.shape,
        )
    if not np.isfinite(values).all():
        raise PolicyError("parameters hold NaN or infinity", key="parameters")
    values.flags.writeable = False
    return values

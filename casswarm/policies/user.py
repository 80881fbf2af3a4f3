"""Policies of users: functions, objects and learned models as policies."""

from __future__ import annotations

import copy
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .._util.interrupts import limited_time
from .._util.text import counted
from ..errors import PolicyCallError, PolicyError
from ..scenario.scenario_files import require_scenario
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy, checked_velocities, is_own, policy_call
from .observation import Observation

if TYPE_CHECKING:
    from ..scenario import Scenario


_REPEATED = 8  # states of a batch that a policy is asked twice
_REPEATED_TOL = 1e-6  # relative to the fastest: what rounding and solvers leave is no randomness


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
                f"step {step}, for {counted(len(alive), 'state')}",
                policy=self.name,
                step=step,
                time_limit=self.time_limit,
            ) from error

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Leaders as of the policy."""
        return self.policy.leaders(step, positions, previous_velocities, alive)


@dataclass(frozen=True)
class RepeatedPolicy(Policy):
    """A policy that is asked again for the first states of every batch, in reverse order."""

    policy: Policy
    name: str

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Decide as the policy, or raise PolicyCallError if it answers a state differently."""
        state = positions, previous_velocities, alive
        decision = self.policy.decide(step, *state)
        first = slice(min(len(alive), _REPEATED) - 1, None, -1)
        again = self.policy.decide(step, *(array[first] for array in state))
        given, other = (
            np.where(alive[first][..., None], velocities, 0.0)
            for velocities in (decision.velocities[first], again.velocities)
        )
        difference = np.abs(given - other)
        if difference.max() > _REPEATED_TOL * np.abs(given).max():
            at = np.unravel_index(difference.argmax(), difference.shape)[:2]
            raise PolicyCallError(
                f"policy {self.name!r} answers the same state differently at step {step}: the "
                f"velocity of member {at[1]} is {given[at]}, then {other[at]}; exact distributions "
                "need a policy that depends on nothing but the state (no randomness, no memory, "
                "no other states of the batch): simulate accepts this one, or seed its generator "
                "from the state",
                policy=self.name,
                step=step,
            )
        return decision

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Leaders as of the policy."""
        return self.policy.leaders(step, positions, previous_velocities, alive)


def repeated(policy: Policy) -> Policy:
    """The policy if it is casswarm's own, else one whose answers are required to be repeatable."""
    users = not is_own(policy) or isinstance(policy, UserPolicy | LimitedPolicy)
    return RepeatedPolicy(policy, policy.name) if users else policy


def as_policy(
    policy: Any,
    scenario: Scenario | None = None,
    *,
    name: str | None = None,
    time_limit: float | None = None,
    parameters: Any = None,
    dtype: Any = None,
) -> Policy:
    """Policy from a `Policy`, an object with a method `velocities`, a function, or a learned model.

    Parameters
    ----------
    policy : Policy, object, function or model
        Without a scenario: the method or function takes (step, positions, previous_velocities,
        alive), of shapes (B, n, 2), (B, n, 2) and (B, n), and returns velocities (B, n, 2). With
        one: a function of observations (B, n, d), as of `casswarm.policies.Observation`, that
        returns velocities (B, n, 2); an object with such a method ``predict``, which is asked for
        deterministic answers if it takes ``deterministic=True``; a ``torch.nn.Module``, of which
        a copy is evaluated; or a ``casadi.Function``, see `parameters`.
    scenario : Scenario, optional
        Of which a model takes observations.
    name : str, optional
        Name in tables; by default that of the object, the function or the class.
    time_limit : float, optional
        Seconds that a call may take, of all states of a batch; a longer one raises an error. A call
        is interrupted on the main thread of a process, as with ``workers=1`` and in worker
        processes; in other threads, such as Dask's, and on Windows the error comes when it ends.
    parameters : array_like, optional
        Parameters of a ``casadi.Function``.
    dtype : dtype, optional
        float32 or float64, of observations; by default that of a module's parameters, or float32.

    Raises
    ------
    PolicyError
        None of these, or a `Policy` without a name.
    ValueError
        A time limit that is not above 0.
    """
    if isinstance(scenario, str):
        raise PolicyError(
            f"the second argument of as_policy is a scenario, not {scenario!r}: the name of a "
            f"policy is given as name={scenario!r}",
            key="scenario",
            value=scenario,
        )
    if time_limit is not None:
        if not time_limit > 0:
            raise ValueError(f"time_limit = {time_limit!r}; allowed: seconds above 0")
        unlimited = as_policy(policy, scenario, name=name, parameters=parameters, dtype=dtype)
        return LimitedPolicy(unlimited, unlimited.name, float(time_limit))
    if isinstance(policy, type):
        raise PolicyError(
            f"{policy.__name__} is a class; pass an instance: {policy.__name__}()",
            policy=policy.__name__,
        )
    if isinstance(policy, Policy):
        if not hasattr(policy, "name"):
            raise PolicyError(
                f"{policy!r} has no name; define one in its class: name = 'mine'",
                policy=repr(policy),
            )
        return policy
    if scenario is not None:
        return model_policy(policy, scenario, name, parameters, dtype)
    function = getattr(policy, "velocities", policy)
    if not callable(function):
        raise PolicyError(
            f"{policy!r} is not a policy: expected a name, a function of (step, positions, "
            "previous_velocities, alive), or an object with such a method called velocities",
            policy=policy,
        )
    default = getattr(policy, "name", None) or getattr(policy, "__name__", type(policy).__name__)
    return UserPolicy(function, name or str(default))


@dataclass(frozen=True, eq=False)
class ObservedModel:
    """A function of (step, positions, previous_velocities, alive) by a model of observations.

    Parameters
    ----------
    model : callable
        Takes observations (B, n, d), returns velocities (B, n, 2).
    observation : Observation
    """

    model: Callable[[NDArray[Any]], Any]
    observation: Observation

    def __call__(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Any:
        """Velocities (B, n, 2) of the model in B states."""
        return self.model(self.observation(step, positions, previous_velocities, alive))


@dataclass(frozen=True, eq=False)
class PredictModel:
    """An object with a method ``predict``, as of Stable-Baselines3 and scikit-learn."""

    model: Any

    def __call__(self, observations: NDArray[Any]) -> Any:
        """The prediction, a deterministic one where that is an option."""
        predict = self.model.predict
        deterministic = "deterministic" in inspect.signature(predict).parameters
        answer = predict(observations, **({"deterministic": True} if deterministic else {}))
        return answer[0] if isinstance(answer, tuple) else answer  # with the state of a network


@dataclass(frozen=True, eq=False)
class TorchModel:
    """A PyTorch module, in evaluation mode and without gradients."""

    module: Any

    def __call__(self, observations: NDArray[Any]) -> NDArray[Any]:
        """The module's output for a tensor of observations, on the module's device."""
        torch = import_module("torch")
        with torch.inference_mode():
            parameter = next(self.module.parameters(), None)
            device = "cpu" if parameter is None else parameter.device
            output = self.module(torch.from_numpy(observations).to(device))
        if not isinstance(output, torch.Tensor):
            return output  # type: ignore[no-any-return]  # `checked_velocities` says what it is
        return np.asarray(output.cpu().numpy())


def model_policy(
    model: Any, scenario: Scenario, name: str | None, parameters: Any, dtype: Any
) -> Policy:
    """Policy of a model; see `casswarm.policies.as_policy`."""
    require_scenario("as_policy", scenario)
    if isinstance(model, ca.Function):
        parametric = import_module(".parametric", __package__)
        named = {"name": name} if name else {}
        policy: Policy = parametric.ParametricPolicy(model, parameters, scenario, **named)
        return policy
    if parameters is not None:
        raise PolicyError(
            f"parameters are for a casadi.Function, not for {type(model).__name__}: a model has "
            "its own",
            key="parameters",
            policy=type(model).__name__,
        )
    default = getattr(model, "name", None) or getattr(model, "__name__", type(model).__name__)
    called: Callable[[NDArray[Any]], Any]
    if _is_torch(model):
        called, own_dtype = _torch_model(model)
        dtype = dtype or own_dtype
    elif callable(getattr(model, "predict", None)):
        called = PredictModel(model)
    elif callable(model):
        called = model
    else:
        raise PolicyError(
            f"{model!r} is not a model: expected a function of observations (B, n, d) that returns "
            "velocities (B, n, 2), an object with such a method called predict, a torch.nn.Module, "
            "or a casadi.Function",
            policy=repr(model),
        )
    observation = Observation.from_scenario(scenario, dtype or "float32")
    return UserPolicy(ObservedModel(called, observation), name or str(default))


def _is_torch(model: Any) -> bool:
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(model, torch.nn.Module)


def _torch_model(module: Any) -> tuple[TorchModel, str | None]:
    """A copy of a module for evaluation, which training does not change, and its dtype."""
    dtypes = [str(p.dtype).removeprefix("torch.") for p in module.parameters()]
    dtype = dtypes[0] if dtypes and dtypes[0] in ("float32", "float64") else None
    return TorchModel(copy.deepcopy(module).eval()), dtype

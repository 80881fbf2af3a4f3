"""Policies of users: functions, objects and learned models as policies."""

from __future__ import annotations

import copy
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from .._util.interrupts import limited_time
from .._util.text import counted, shown
from ..errors import PolicyError
from ..scenario.scenario_files import require_scenario
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy, call_error, checked_velocities, is_own, policy_call
from .observation import DTYPES, Observation

if TYPE_CHECKING:
    from ..guide.guide import Guide
    from ..scenario import Scenario


_REPEATED = 8  # states of a batch that a policy is asked twice
_REPEATED_TOL = 1e-5  # relative to the fastest: single precision and solvers are no randomness


@dataclass(frozen=True)
class UserPolicy(Policy):
    """Policy from a user's function of (step, positions, previous_velocities, alive)."""

    function: Callable[[int, FloatArray, FloatArray, BoolArray], Any]
    name: str

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        with policy_call(self.name, step):
            velocities = self.function(step, positions, previous_velocities, alive)
        return Decision.plain(checked_velocities(self.name, step, velocities, alive))


@dataclass(frozen=True)
class _WrappedPolicy(Policy):
    """A policy with another one's decisions and leaders."""

    policy: Policy
    name: str

    @override
    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        return self.policy.leaders(step, positions, previous_velocities, alive)


@dataclass(frozen=True)
class _LimitedPolicy(_WrappedPolicy):
    """A policy whose calls may take a number of seconds; see `as_policy`."""

    time_limit: float

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        try:
            with limited_time(self.time_limit):
                return self.policy.decide(step, positions, previous_velocities, alive)
        except TimeoutError as error:
            limit, states = self.time_limit, counted(len(alive), "state")
            text = f"took longer than its time limit of {limit:g} s at step {step}, for {states}"
            raise call_error(self.name, step, text, time_limit=limit) from error


class _RepeatedPolicy(_WrappedPolicy):
    """A policy that is asked again for the first states of every batch, in reverse order."""

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
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
            text = (
                f"answers the same state differently at step {step}: the velocity of member "
                f"{at[1]} is {given[at]}, then {other[at]}; runs in equal states share one answer, "
                "so a policy must depend on nothing but the state (no randomness, no memory, no "
                "other states of the batch); a random choice needs a generator that is seeded from "
                "the state"
            )
            where = {"state": len(given) - 1 - int(at[0]), "member": int(at[1])}
            raise call_error(self.name, step, text, velocity=given[at], expected=other[at], **where)
        return decision


def repeated(policy: Policy) -> Policy:
    """The policy if its code is casswarm's own, else one that must repeat its answers.

    Functions that PyTorch evaluates may have memory; those of CasADi and JAX are traced once.
    """
    users = not is_own(policy) or isinstance(policy, UserPolicy | _LimitedPolicy)
    users = users or getattr(policy, "framework", None) == "torch"
    return _RepeatedPolicy(policy, policy.name) if users else policy


def as_policy(
    policy: Any,
    scenario: Scenario | None = None,
    *,
    name: str | None = None,
    time_limit: float | None = None,
    parameters: Any = None,
    dtype: Any = None,
    observed_guide: Guide | None = None,
    radar_preview: int = 0,
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
    observed_guide : Guide, optional
        Whose reference a model observes, if it was trained with ``observe_guide=True``; the guide
        of `simulate` or `evaluate` itself is not observed.
    radar_preview : int
        That with which a model was trained: see `casswarm.envs`.

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
            raise ValueError(f"time_limit = {shown(time_limit)}; allowed: seconds above 0")
        options = {"parameters": parameters, "dtype": dtype, "observed_guide": observed_guide}
        unlimited = as_policy(policy, scenario, name=name, radar_preview=radar_preview, **options)
        return _LimitedPolicy(unlimited, unlimited.name, float(time_limit))
    if observed_guide is not None and (
        scenario is None or isinstance(policy, Policy | ca.Function)
    ):
        raise PolicyError(
            "observed_guide is for a model that takes observations, and needs its scenario: "
            "as_policy(model, scenario, observed_guide=guide)",
            key="observed_guide",
        )
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
        observed = {"guide": observed_guide, "preview": radar_preview}
        return _model_policy(policy, scenario, name, parameters, dtype, observed)
    function = getattr(policy, "velocities", policy)
    if not callable(function):
        raise PolicyError(
            f"{policy!r} is not a policy: expected a name, a function of (step, positions, "
            "previous_velocities, alive), or an object with such a method called velocities",
            policy=repr(policy),
        )
    return UserPolicy(function, name or _name_of(policy))


@dataclass(frozen=True, eq=False)
class _ObservedModel:
    """A function of states by a model of observations (B, n, d), which returns (B, n, 2)."""

    model: Callable[[NDArray[Any]], Any]
    observation: Observation

    def __call__(self, step: int, *state: Any) -> Any:
        """Velocities (B, n, 2) of the model in B states."""
        return self.model(self.observation(step, *state))


def _predict(model: Any, observations: NDArray[Any]) -> Any:
    """Prediction as of Stable-Baselines3 and scikit-learn, deterministic where it is an option."""
    deterministic = "deterministic" in inspect.signature(model.predict).parameters
    answer = model.predict(observations, **({"deterministic": True} if deterministic else {}))
    return answer[0] if isinstance(answer, tuple) else answer  # with the state of a network


def _evaluate_module(module: Any, observations: NDArray[Any]) -> Any:
    """Output of a PyTorch module for observations, without gradients, on the module's device."""
    torch = import_module("torch")
    with torch.inference_mode():
        parameter = next(module.parameters(), None)
        device = "cpu" if parameter is None else parameter.device
        output = module(torch.from_numpy(observations).to(device))
    return output.cpu().numpy() if isinstance(output, torch.Tensor) else output


def _model_policy(
    model: Any,
    scenario: Scenario,
    name: str | None,
    parameters: Any,
    dtype: Any,
    observed: dict[str, Any],
) -> Policy:
    """Policy of a model; see `as_policy`. `observed` are arguments of its observations."""
    require_scenario("as_policy", scenario)
    if isinstance(model, ca.Function):
        from .parametric import ParametricPolicy

        named = {"name": name} if name else {}
        return ParametricPolicy(model, parameters, scenario, **named)
    if parameters is not None:
        raise PolicyError(
            f"parameters are for a casadi.Function, not for {type(model).__name__}: a model has "
            "its own",
            key="parameters",
            policy=type(model).__name__,
        )
    called: Callable[[NDArray[Any]], Any]
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(model, torch.nn.Module):
        called = partial(_evaluate_module, copy.deepcopy(model).eval())  # training changes no copy
        dtypes = [str(p.dtype).removeprefix("torch.") for p in model.parameters()]
        dtype = dtype or (dtypes[0] if dtypes[:1] and dtypes[0] in DTYPES else None)
    elif callable(getattr(model, "predict", None)):
        called = partial(_predict, model)
    elif callable(model):
        called = model
    else:
        raise PolicyError(
            f"{model!r} is not a model: expected a function of observations (B, n, d) that returns "
            "velocities (B, n, 2), an object with such a method called predict, a torch.nn.Module, "
            "or a casadi.Function",
            policy=repr(model),
        )
    observation = Observation.from_scenario(scenario, dtype or "float32", **observed)
    return UserPolicy(_ObservedModel(called, observation), name or _name_of(model))


def _name_of(found: Any) -> str:
    """Name of an object, a function or else of the class."""
    name = getattr(found, "name", None) or getattr(found, "__name__", type(found).__name__)
    return str(name)

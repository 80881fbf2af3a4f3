"""Learned models as policies: from a state to observations, to the model's actions."""

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

from ..errors import PolicyError
from ..scenario.io import require_scenario
from ..typing import BoolArray, FloatArray
from .base import Policy
from .observation import Observation
from .user import UserPolicy

if TYPE_CHECKING:
    from ..scenario import Scenario


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
            "its own"
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
            "or a casadi.Function"
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

"""Policies with parameters, given as functions of CasADi, JAX or PyTorch, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import override

from .._util.extras import require_extra
from .._util.text import counted, shown
from .._util.threads import locked_cache, one_at_a_time
from .._util.user_code import USER_ERRORS, failure_text
from ..errors import PolicyError
from ..motion.step import Motion
from ..solvers.interior_point.tape import MAX_ARGUMENTS, Tape, scalar
from ..typing import BoolArray, Expr, FloatArray, IntArray, States
from .base import Decision, Policy, call_error, checked_velocities, policy_call

if TYPE_CHECKING:
    from ..scenario import Scenario

CHUNK = 1024  # entries of a batch that are evaluated at once: bounds memory

_Derivatives: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Derivatives with respect to positions and previous velocities (B, n, 2), and parameters (p,)."""


@dataclass(frozen=True, eq=False)
class BatchFunction:
    """A function of up to three columns, some of whose results are dense columns.

    Functions of scalar operations are evaluated by a compiled loop over them; others, such as those
    that call external code, by ``Function.map``.
    """

    call: Callable[..., Sequence[FloatArray]]

    @classmethod
    @one_at_a_time
    def of(cls, arguments: Sequence[Expr], outputs: Sequence[Expr]) -> BatchFunction:
        """Function of MX columns `arguments` with the values of MX columns `outputs`."""
        assert len(arguments) <= MAX_ARGUMENTS
        dense = [ca.densify(output) for output in outputs]
        function = ca.Function("batch", list(arguments), dense)
        symbols = [ca.SX.sym("v", argument.numel()) for argument in arguments]
        try:
            return cls(Tape.of(symbols, list(scalar(function).call(symbols))))
        except NotImplementedError:
            return cls(_mapped(function))

    def __call__(self, *arguments: FloatArray) -> list[FloatArray]:
        """Outputs (m, B) at arguments (k, B); at (k,), an argument is the same for all."""
        batch = next(a.shape[1] for a in arguments if a.ndim == 2)
        parts = []
        for first in range(0, batch, CHUNK):
            size = min(CHUNK, batch - first)
            chunk = slice(first, first + size)
            columns = (
                a[:, chunk] if a.ndim == 2 else np.repeat(a[:, None], size, axis=1)
                for a in arguments
            )
            parts.append(self.call(*map(np.ascontiguousarray, columns)))
        return [np.concatenate(outputs, axis=1) for outputs in zip(*parts, strict=True)]


def _mapped(function: Expr) -> Callable[..., list[FloatArray]]:
    """Evaluation by ``Function.map``, of batches of up to `CHUNK` entries, built for few sizes."""
    maps: dict[int, Expr] = {}

    def call(*arguments: FloatArray) -> list[FloatArray]:
        batch = arguments[0].shape[1]
        size = min(CHUNK, 1 << max(0, batch - 1).bit_length())
        if size not in maps:
            maps[size] = one_at_a_time(function.map)(size)
        padded = (np.pad(a, ((0, 0), (0, size - batch)), mode="edge") for a in arguments)
        return [np.asarray(output)[:, :batch] for output in maps[size].call(list(padded))]

    return call


@dataclass(frozen=True, eq=False)
class StateFunction:
    """A user's function of steps, states and parameters, with derivatives.

    `evaluate` takes (step, parameters, positions, previous_velocities, alive), the last three of B
    states, and returns velocities for each; `differentiate` takes these, seeds and weights, and
    returns what `derivatives` does. Where it is `chunked`, they get up to `CHUNK` states at a time,
    padded by the last one to powers of two, so that functions are compiled for few sizes.
    """

    name: str
    evaluate: Callable[..., NDArray[Any]]
    differentiate: Callable[..., _Derivatives]
    chunked: bool = True

    def values(self, step: int, states: States, parameters: FloatArray) -> FloatArray:
        """Velocities (B, n, 2) in B states."""
        if not self.chunked:
            return self.evaluate(step, parameters, *states)
        parts, expected = [], states[0].shape[1:]
        for rows, count in _chunks(len(states[0])):
            chunk = [part[rows] for part in states]
            with policy_call(self.name, step):
                parts.append(self.evaluate(step, parameters, *chunk)[:count])
        _require_velocities(self.name, step, parts[0].shape[1:], expected)
        return np.concatenate(parts)

    def derivatives(
        self, step: int, states: States, at: FloatArray, seeds: FloatArray, weights: FloatArray
    ) -> _Derivatives:
        """Products of seeds with the derivatives at parameters; see `ParametricPolicy.adjoint`."""
        if not self.chunked:
            return self.differentiate(step, at, *states, seeds, weights)
        to_positions, to_previous = np.empty_like(seeds), np.empty_like(seeds)
        to_parameters = np.zeros_like(at)
        for rows, count in _chunks(len(weights)):
            chunk = [part[rows] for part in (*states, seeds)]
            once = np.where(np.arange(len(rows)) < count, weights[rows], 0.0)
            with policy_call(self.name, step):
                x, v, p = self.differentiate(step, at, *chunk, once)
            to_positions[rows[:count]], to_previous[rows[:count]] = x[:count], v[:count]
            to_parameters += p
        return to_positions, to_previous, to_parameters

    def tried(self, n: int, size: int) -> StateFunction:
        """The function itself, if it returns a velocity for each of n members at step 0."""
        self.values(0, (*np.zeros((2, 1, n, 2)), np.ones((1, n), bool)), np.zeros(size))
        return self


def _chunks(batch: int) -> Iterator[tuple[IntArray, int]]:
    """Padded numbers of states that are evaluated at once, and how many they are without it."""
    for first in range(0, batch, CHUNK):
        count = min(CHUNK, batch - first)
        yield first + np.minimum(np.arange(1 << (count - 1).bit_length()), count - 1), count


def _require_velocities(name: str, step: int, shape: Any, expected: tuple[int, ...]) -> None:
    if shape != expected:
        text = f"returned shape {shape} at step {step}; expected {expected}"
        raise call_error(
            name, step, f"{text}: a velocity for every member", shape=shape, expected=expected
        )


@dataclass(frozen=True, eq=False)
class _ByIdentity:
    """A user's function, which need not be hashable, as a key."""

    function: Callable[..., Any]
    name: str

    def __hash__(self) -> int:
        return id(self.function)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _ByIdentity):
            return NotImplemented
        return self.function is other.function and self.name == other.name


def _casadi_function(key: _ByIdentity, n: int, size: int) -> StateFunction:
    """State function of a CasADi function of expressions (n, 2), (n, 2), (n, 1) and (p, 1)."""
    _compiled(key, n, size, 0)

    def evaluate(step: int, parameters: FloatArray, *states: Any) -> Any:
        function = _compiled(key, n, size, step)
        (values,) = function.values(_columns(*states), parameters[function.used])
        return values.T.reshape(states[0].shape)

    def differentiate(step: int, parameters: FloatArray, *arrays: Any) -> Any:
        *states, seeds, weights = arrays
        function, batch = _compiled(key, n, size, step), len(weights)
        to_state, to_used = function.derivatives(
            _columns(*states), parameters[function.used], seeds.reshape(batch, -1).T
        )
        to_parameters = np.zeros_like(parameters)
        to_parameters[function.used] = to_used @ weights
        to_positions, to_previous = to_state.reshape(2, -1, batch)
        return (
            *(part.T.reshape(seeds.shape) for part in (to_positions, to_previous)),
            to_parameters,
        )

    return StateFunction(key.name, evaluate, differentiate, chunked=False)


class _StepFunction(NamedTuple):
    """A CasADi function at a step, of the parameters (q,) that it depends on.

    States (5n, B) and parameters (q,) give velocities (2n, B); with seeds (2n, B), derivatives
    (4n, B) and (q, B).
    """

    used: IntArray
    values: BatchFunction
    derivatives: BatchFunction


@locked_cache(maxsize=512)
def _compiled(key: _ByIdentity, n: int, size: int, step: int) -> _StepFunction:
    """Compiled values and derivatives of a user's function at a step."""
    state, parameters = ca.MX.sym("state", 5 * n), ca.MX.sym("parameters", size)
    positions, previous = (ca.reshape(state[2 * n * k : 2 * n * (k + 1)], 2, n).T for k in (0, 1))
    try:
        returned = key.function(step, positions, previous, state[4 * n :], parameters)
        velocities: Any = ca.MX(returned)
    except USER_ERRORS as error:
        text = f"failed at step {step} with CasADi arguments: {failure_text(error)}"
        raise call_error(key.name, step, text) from error
    _require_velocities(key.name, step, velocities.shape, (n, 2))
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


def _jax_function(key: _ByIdentity, n: int, size: int) -> StateFunction:
    """State function of a JAX function, compiled once for all steps; the step is traced too."""
    require_extra("jax", "jax")
    import jax
    import jax.numpy as jnp

    def of_state(step: Any, parameters: Any, *state: Any) -> Any:
        return jnp.asarray(key.function(step, *state, parameters), float)

    batched = jax.vmap(of_state, in_axes=(None, None, 0, 0, 0))

    def differentiate(
        step: Any, parameters: Any, x: Any, v: Any, alive: Any, seeds: Any, weights: Any
    ) -> Any:
        _, pull = jax.vjp(lambda *args: batched(step, *args, alive), parameters, x, v)
        _, to_positions, to_previous = pull(seeds)
        return to_positions, to_previous, pull(weights[:, None, None] * seeds)[0]

    def in_double(compiled: Any) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            with jax.enable_x64(True):
                return jax.device_get(compiled(*arguments))

        return call

    evaluate, derive = in_double(jax.jit(batched)), in_double(jax.jit(differentiate))
    return StateFunction(key.name, evaluate, derive).tried(n, size)


def _torch_function(key: _ByIdentity, n: int, size: int) -> StateFunction:
    """State function of a PyTorch function, called with tensors on the default device."""
    require_extra("torch", "torch")
    import torch

    def batched(step: int, parameters: Any, *states: Any) -> Any:
        def of_state(*state: Any) -> Any:
            return torch.as_tensor(key.function(step, *state, parameters), dtype=torch.float64)

        return torch.func.vmap(of_state)(*states)

    def evaluate(step: int, *arrays: Any) -> Any:
        with torch.no_grad(), _one_thread(torch):
            return batched(step, *map(torch.tensor, arrays)).numpy(force=True)

    def differentiate(step: int, *arrays: Any) -> Any:
        parameters, x, v, alive, seeds, weights = map(torch.tensor, arrays)
        with _one_thread(torch):
            _, pull = torch.func.vjp(lambda *args: batched(step, *args, alive), parameters, x, v)
            _, to_positions, to_previous = pull(seeds)
            to_parameters = pull(weights[:, None, None] * seeds)[0]
        return tuple(part.numpy(force=True) for part in (to_positions, to_previous, to_parameters))

    return StateFunction(key.name, evaluate, differentiate).tried(n, size)


@contextmanager
def _one_thread(torch: Any) -> Iterator[None]:
    """Let PyTorch use one thread: chunks are small, and threads wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


_FRAMEWORKS: dict[str, Callable[[_ByIdentity, int, int], StateFunction]] = {
    "casadi": _casadi_function,
    "jax": _jax_function,
    "torch": _torch_function,
}
"""Makers of a `StateFunction` of n members and p parameters; each tries the function at step 0."""


@locked_cache(maxsize=64)
def _state_function(framework: str, key: _ByIdentity, n: int, size: int) -> StateFunction:
    """The function of a policy of n members, compiled once."""
    if framework not in _FRAMEWORKS:
        allowed = ", ".join(_FRAMEWORKS)
        raise PolicyError(
            f"framework = {shown(framework)}; allowed: {allowed}",
            framework=framework,
            allowed=allowed,
        )
    return _FRAMEWORKS[framework](key, n, size)


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
        object.__setattr__(self, "parameters", _checked_parameters(self.parameters))
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
        values = _checked_parameters(parameters)
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

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
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
        self, step: int, states: States, seeds: FloatArray, weights: FloatArray
    ) -> _Derivatives:
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
            text = f"has a derivative at step {step} that is not finite; avoid roots and norms of "
            text += "numbers that can be zero, such as distances of the destroyed"
            raise call_error(self.name, step, text)
        return derivatives

    def _state_function(self) -> StateFunction:
        key = _ByIdentity(self.function, self.name)
        return _state_function(self.framework, key, self.scenario.n, self.parameters.size)


def _checked_parameters(parameters: ArrayLike) -> FloatArray:
    """Parameters as a read-only vector (p,) of finite numbers."""
    try:
        values = np.asarray(parameters, dtype=float).copy()
    except (TypeError, ValueError):
        raise PolicyError(
            f"parameters are {shown(parameters)}; expected a vector of numbers",
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

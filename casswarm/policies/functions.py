"""Users' functions of a state and parameters, with derivatives, whatever they are written in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .._util.extras import require_extra
from .._util.threads import locked_cache, one_at_a_time
from .._util.user_code import USER_ERRORS, failure_text
from ..errors import PolicyCallError, PolicyError
from ..solvers.interior_point.tape import MAX_ARGUMENTS, Tape, scalar
from ..typing import BoolArray, Expr, FloatArray, IntArray, States
from .base import policy_call

CHUNK = 1024  # entries of a batch that are evaluated at once: bounds memory

_Call = Callable[..., list[FloatArray]]


@dataclass(frozen=True, eq=False)
class BatchFunction:
    """A function of up to three columns, some of whose results are dense columns.

    Functions of scalar operations are evaluated by a compiled loop over them; others, such as those
    that call external code, by ``Function.map``.
    """

    call: _Call

    @classmethod
    @one_at_a_time
    def of(cls, arguments: Sequence[Expr], outputs: Sequence[Expr]) -> BatchFunction:
        """Function of MX columns `arguments` with the values of MX columns `outputs`."""
        assert len(arguments) <= MAX_ARGUMENTS
        dense = [ca.densify(output) for output in outputs]
        function = ca.Function("batch", list(arguments), dense)
        symbols = [ca.SX.sym("v", argument.numel()) for argument in arguments]
        try:
            tape = Tape.of(symbols, list(scalar(function).call(symbols)))
        except NotImplementedError:
            return cls(_mapped(function))
        return cls(tape)

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


def _mapped(function: Expr) -> _Call:
    """Evaluation by ``Function.map``, of batches of up to `CHUNK` entries, built for few sizes."""
    maps: dict[int, Expr] = {}

    def call(*arguments: FloatArray) -> list[FloatArray]:
        batch = arguments[0].shape[1]
        size = min(CHUNK, 1 << max(0, batch - 1).bit_length())
        if size not in maps:
            maps[size] = one_at_a_time(function.map)(size)
        padded = (np.pad(a, ((0, 0), (0, size - batch)), mode="edge") for a in arguments)
        outputs = maps[size].call(list(padded))
        return [np.asarray(output)[:, :batch] for output in outputs]

    return call


@dataclass(frozen=True, eq=False)
class CasadiFunction:
    """A CasADi function; see `casswarm.policies.functions.StateFunction`.

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


@dataclass(frozen=True, eq=False)
class ArrayFunction:
    """A function of arrays in double precision; see `casswarm.policies.functions`.

    Parameters
    ----------
    name : str
    evaluate : callable
        Takes (step, parameters, positions, previous_velocities, alive), all but the first two for
        B states, and returns velocities for each.
    differentiate : callable
        Takes these, seeds and weights, and returns what `derivatives` does.
    """

    name: str
    evaluate: Callable[..., NDArray[Any]]
    differentiate: Callable[..., tuple[FloatArray, FloatArray, FloatArray]]

    def values(self, step: int, states: States, parameters: FloatArray) -> FloatArray:
        """Velocities (B, n, 2) in B states."""
        parts, expected = [], states[0].shape[1:]
        for rows, count in _chunks(len(states[0])):
            chunk = [part[rows] for part in states]
            with policy_call(self.name, step):
                parts.append(self.evaluate(step, parameters, *chunk)[:count])
        if parts[0].shape[1:] != expected:
            raise PolicyCallError(
                f"policy {self.name!r} returned shape {parts[0].shape[1:]} at step {step}; "
                f"expected {expected}: a velocity for every member",
                policy=self.name,
                step=step,
            )
        return np.concatenate(parts)

    def derivatives(
        self,
        step: int,
        states: States,
        parameters: FloatArray,
        seeds: FloatArray,
        weights: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products of seeds with the derivatives; see `ParametricPolicy.adjoint`."""
        to_positions, to_previous = np.empty_like(seeds), np.empty_like(seeds)
        to_parameters = np.zeros_like(parameters)
        for rows, count in _chunks(len(weights)):
            chunk = [part[rows] for part in (*states, seeds)]
            once = np.where(np.arange(len(rows)) < count, weights[rows], 0.0)
            with policy_call(self.name, step):
                x, v, p = self.differentiate(step, parameters, *chunk, once)
            to_positions[rows[:count]], to_previous[rows[:count]] = x[:count], v[:count]
            to_parameters += p
        return to_positions, to_previous, to_parameters

    def tried(self, n: int, size: int) -> ArrayFunction:
        """The function itself, if it returns a velocity for each of n members at step 0."""
        self.values(0, (*np.zeros((2, 1, n, 2)), np.ones((1, n), bool)), np.zeros(size))
        return self


def _chunks(batch: int) -> Iterator[tuple[IntArray, int]]:
    """Numbers of up to `CHUNK` states, and how many they are.

    They are padded by the last one to powers of two, so that functions are compiled for few sizes.
    """
    for first in range(0, batch, CHUNK):
        count = min(CHUNK, batch - first)
        yield first + np.minimum(np.arange(1 << (count - 1).bit_length()), count - 1), count


def jax_function(function: Callable[..., Any], name: str, n: int, size: int) -> ArrayFunction:
    """Of a JAX function, compiled once for all steps, which are traced as the states are."""
    require_extra("jax", "jax")
    import jax
    import jax.numpy as jnp

    def of_state(step: Any, parameters: Any, *state: Any) -> Any:
        return jnp.asarray(function(step, *state, parameters), float)

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
    return ArrayFunction(name, evaluate, derive).tried(n, size)


def torch_function(function: Callable[..., Any], name: str, n: int, size: int) -> ArrayFunction:
    """Of a PyTorch function, which is called with tensors on the default device."""
    require_extra("torch", "torch")
    import torch

    def batched(step: int, parameters: Any, *states: Any) -> Any:
        def of_state(*state: Any) -> Any:
            return torch.as_tensor(function(step, *state, parameters), dtype=torch.float64)

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

    return ArrayFunction(name, evaluate, differentiate).tried(n, size)


@contextmanager
def _one_thread(torch: Any) -> Iterator[None]:
    """Let PyTorch use one thread: chunks are small, and threads wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


FRAMEWORKS: dict[str, Callable[..., StateFunction]] = {
    "casadi": CasadiFunction,
    "jax": jax_function,
    "torch": torch_function,
}
"""What makes a `StateFunction` of a function, its name and the numbers of members and parameters;
each tries the function at step 0."""


class StateFunction(Protocol):
    """A function of steps, states and parameters.

    States are positions and previous velocities (B, n, 2) and the living (B, n).
    """

    def values(self, step: int, states: States, parameters: FloatArray) -> FloatArray:
        """Velocities (B, n, 2) in B states."""

    def derivatives(
        self,
        step: int,
        states: States,
        parameters: FloatArray,
        seeds: FloatArray,
        weights: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products of seeds with the derivatives; see `ParametricPolicy.adjoint`."""


@dataclass(frozen=True, eq=False)
class ByIdentity:
    """A user's function, which need not be hashable, as a key."""

    function: Callable[..., Any]
    name: str

    def __hash__(self) -> int:
        return id(self.function)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ByIdentity):
            return NotImplemented
        return self.function is other.function and self.name == other.name


@locked_cache(maxsize=64)
def state_function(framework: str, key: ByIdentity, n: int, size: int) -> StateFunction:
    """The function of a policy of n members, compiled once.

    Raises
    ------
    PolicyError
        An unknown framework; a function that fails at step 0, or returns another shape.
    ExtraError
        The framework's package is not installed.
    """
    if framework not in FRAMEWORKS:
        raise PolicyError(
            f"framework = {framework!r}; allowed: {', '.join(FRAMEWORKS)}",
            framework=framework,
            allowed=", ".join(FRAMEWORKS),
        )
    return FRAMEWORKS[framework](key.function, key.name, n, size)

"""Users' JAX and PyTorch functions of a state and parameters, over batches, with derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._util.extras import require_extra
from ..errors import PolicyCallError
from ..typing import FloatArray, IntArray, States
from .batch_function import CHUNK
from .decision import policy_call


@dataclass(frozen=True, eq=False)
class ArrayFunction:
    """A function of arrays in double precision; see `casswarm.policies.state_function`.

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

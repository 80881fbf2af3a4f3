"""Users' functions of a state and parameters, with derivatives, whatever they are written in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from .._util.threads import locked_cache
from ..errors import PolicyError
from ..typing import FloatArray, States
from .array_function import jax_function, torch_function
from .casadi_function import CasadiFunction

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
        raise PolicyError(f"framework = {framework!r}; allowed: {', '.join(FRAMEWORKS)}")
    return FRAMEWORKS[framework](key.function, key.name, n, size)

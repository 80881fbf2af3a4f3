"""Programs as layers of PyTorch and JAX: parameters to solutions, with derivatives backwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from .._util.extras import require_extra
from ..errors import SolverError
from ..nlp.program import Instances, Nlp
from ..typing import FloatArray
from .base import Solver
from .interior_point.solver import FilterInteriorPoint


def layer(
    program: Nlp, instances: Instances, framework: str = "torch", solver: Solver | None = None
) -> Callable[[Any], Any]:
    """Function of parameters to solutions, to be differentiated backwards by a framework.

    Parameters
    ----------
    program : Nlp
    instances : Instances
        Initial guesses and bounds: of a single instance, or one for each row of parameters. Their
        own parameters are not used.
    framework : {"torch", "jax"}
        Needs the extra of the same name.
    solver : Solver, optional
        By default `FilterInteriorPoint`.

    Returns
    -------
    callable
        Parameters (B, np) to solutions (B, nx), both arrays of the framework of the same type.
        Solutions that are not found are NaN, and so are the derivatives of those and of instances
        that are not regular (see `Sensitivities`).

    Raises
    ------
    SolverError
        The framework is unknown; or when called, shapes do not fit the program.
    ExtraError
        The framework is not installed.
    """
    if framework not in _FRAMEWORKS:
        allowed = ", ".join(_FRAMEWORKS)
        message = f"framework = {framework!r}; allowed: {allowed}"
        raise SolverError(message, key="framework", value=framework, allowed=allowed)
    require_extra(framework, framework)
    chosen = FilterInteriorPoint() if solver is None else solver

    def solve(p: FloatArray) -> tuple[FloatArray, Adjoint]:
        p = np.asarray(p, dtype=float)
        if p.ndim != 2 or len(instances) not in (1, len(p)):
            message = f"parameters have shape {p.shape}; expected: ({len(instances)}, np)"
            raise SolverError(message, key="p", shape=p.shape)
        rows = np.zeros(len(p), int) if len(instances) == 1 else np.arange(len(p))
        posed = replace(instances[rows], p=p)
        solution = chosen.solve_batch(program, posed, sensitivities=True)
        assert solution.sensitivities is not None
        x = np.where(solution.success[:, None], solution.x, np.nan)
        return x, solution.sensitivities.adjoint

    return _FRAMEWORKS[framework](solve, program.sizes[0])


Adjoint = Callable[..., FloatArray]
Solve = Callable[[FloatArray], tuple[FloatArray, Adjoint]]


def _torch(solve: Solve, _: int) -> Callable[[Any], Any]:
    import torch

    class Layer(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, p: Any) -> Any:
            x, ctx.adjoint = solve(p.numpy(force=True))
            return torch.as_tensor(x, dtype=p.dtype, device=p.device)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, bar: Any) -> Any:
            product = ctx.adjoint(bar.numpy(force=True).astype(float))
            return torch.as_tensor(product, dtype=bar.dtype, device=bar.device)

    function: Callable[[Any], Any] = Layer.apply
    return function


def _jax(solve: Solve, size: int) -> Callable[[Any], Any]:
    import jax

    def call(function: Callable[..., FloatArray], width: int, *arrays: Any) -> Any:
        like = jax.ShapeDtypeStruct((len(arrays[0]), width), arrays[0].dtype)

        def of_arrays(*values: Any) -> Any:
            return function(*(np.asarray(v, dtype=float) for v in values)).astype(like.dtype)

        return jax.pure_callback(of_arrays, like, *arrays)

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def solution(p: Any) -> Any:
        return call(lambda values: solve(values)[0], size, p)

    def forward(p: Any) -> tuple[Any, Any]:
        return solution(p), p

    def backward(p: Any, bar: Any) -> tuple[Any]:
        return (call(lambda values, seeds: solve(values)[1](seeds), p.shape[1], p, bar),)

    solution.defvjp(forward, backward)
    function: Callable[[Any], Any] = solution
    return function


_FRAMEWORKS: dict[str, Callable[[Solve, int], Callable[[Any], Any]]] = {
    "torch": _torch,
    "jax": _jax,
}

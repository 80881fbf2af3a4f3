"""The paper's projected gradient method, with a constant step and exact projections."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np

from ...errors import SolverError
from ...typing import BoolArray, FloatArray
from ..feasible_sets.planar import PlanarSets
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Capabilities, Solver
from .options import NonNegative, NonNegativeInt, PositiveFinite

_CHUNK = 256  # instances evaluated at once


@dataclass(frozen=True)
class ProjectedGradient(Solver):
    """x <- P(x - step grad f(x)), the paper's algorithm of sections III and IV.

    Bertsekas, Tsitsiklis, Parallel and Distributed Computation, section 3.3.2. For problems whose
    constraints are a box, or a product of boxes and discs in the plane (`Instances.feasible_set`).
    Batched: all instances advance together, and each stops on its own.

    Parameters
    ----------
    step : float
        The paper's learning rate.
    max_iter : int
    tolerance : float
        An instance has converged when no component of x moves by more than `tolerance` times the
        step in one iteration. Reaching `max_iter` is not a success.
    keep : {"last", "best"}
        Which iterate is the answer: the last, or the one with the smallest objective (with a
        constant step the iterates may circle around a kink).
    start : {"x0", "zero"}
        Initial guess: that of the instance, or the projection of zero, as in the paper for the
        formation.
    """

    step: PositiveFinite = 0.05
    max_iter: NonNegativeInt = 2000
    tolerance: NonNegative = 1e-6
    keep: Literal["last", "best"] = "last"
    start: Literal["x0", "zero"] = "x0"

    name: ClassVar[str] = "projected-gradient"
    summary: ClassVar[str] = "the paper's constant-step method; boxes and discs only"
    capabilities: ClassVar[Capabilities] = Capabilities("product sets", batch=True)

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        _ = nlp.gradient

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        if nlp.constraints and not isinstance(instances.feasible_set, PlanarSets):
            raise SolverError(
                f"projected-gradient cannot solve {nlp.name}: its constraints "
                f"({', '.join(nlp.constraints)}) are not a product of boxes and discs"
            )
        answers: list[Answer] = []
        for start in range(0, len(instances), _CHUNK):
            answers += self._run_chunk(nlp, instances[slice(start, start + _CHUNK)])
        return answers

    def _run_chunk(self, nlp: Nlp, instances: Instances) -> list[Answer]:
        started = time.perf_counter()
        origin = np.zeros_like(instances.x0) if self.start == "zero" else instances.x0
        x = _project(instances, origin)
        answer, smallest = x.copy(), np.full(len(x), np.inf)
        iterations = np.full(len(x), self.max_iter)
        converged = np.zeros(len(x), bool)
        active, remaining = np.arange(len(x)), instances
        for iteration in range(self.max_iter):
            objective, gradient = _gradients(nlp, x[active], remaining.p)
            if self.keep == "best":
                better = objective < smallest[active]
                smallest[active[better]] = objective[better]
                answer[active[better]] = x[active[better]]
            step = x[active] - self.step * gradient
            finite: BoolArray = np.asarray(np.isfinite(step).all(axis=1))
            projected = _project(remaining, np.where(finite[:, None], step, x[active]))
            change = np.abs(projected - x[active]).max(axis=1, initial=0.0)
            x[active] = np.where(finite[:, None], projected, np.nan)
            done: BoolArray = np.asarray(~finite | (change <= self.tolerance * self.step))
            if done.any():
                iterations[active[done]] = iteration + 1
                converged[active[done]] = finite[done]
                active = active[~done]
                remaining = instances[active]
            if not active.size:
                break
        diverged: BoolArray = np.asarray(~np.isfinite(x).all(axis=1))
        if self.keep == "last":
            answer = x
        seconds = (time.perf_counter() - started) / max(1, len(x))
        return [
            Answer(
                answer[i],
                *_outcome(diverged[i], converged[i]),
                int(iterations[i]),
                int(iterations[i]),
                seconds,
            )
            for i in range(len(x))
        ]


def _outcome(diverged: np.bool_, converged: np.bool_) -> tuple[Status, str]:
    if diverged:
        return Status.FAILED, "gradient not finite"
    if converged:
        return Status.SOLVED, "step below tolerance"
    return Status.ITERATION_LIMIT, "iterations exhausted"


def _project(instances: Instances, x: FloatArray) -> FloatArray:
    sets = instances.feasible_set
    if not isinstance(sets, PlanarSets):
        return np.clip(x, instances.lbx, instances.ubx)
    return sets.project(x.reshape(*sets.shape, 2)).reshape(x.shape)


def _gradients(nlp: Nlp, x: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Objectives (B,) and gradients (B, nx) at x (B, nx); not finite where they do not exist.

    Batches are padded to powers of two, so that few sizes of `Function.map` are built.
    """
    f, gradient = np.empty(len(x)), np.empty_like(x)
    for first in range(0, len(x), _CHUNK):
        rows = slice(first, first + _CHUNK)
        f[rows], gradient[rows] = _chunk(nlp, x[rows], parameters[rows])
    return f, gradient


def _chunk(nlp: Nlp, x: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    size = 1 << max(0, len(x) - 1).bit_length()
    pad = ((0, size - len(x)), (0, 0))
    f, gradient = _mapped(nlp, size)(np.pad(x, pad, "edge").T, np.pad(parameters, pad, "edge").T)
    return np.asarray(f)[0, : len(x)], np.asarray(gradient).T[: len(x)]


@lru_cache(maxsize=64)
def _mapped(nlp: Nlp, size: int) -> Any:
    return nlp.gradient.map(size)

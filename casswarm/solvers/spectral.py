"""The nonmonotone spectral projected gradient, compiled, over batches."""

from __future__ import annotations

import inspect
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar

import numpy as np

from ..arrays import Counts, Floats
from ..compiling import compiled_module
from ..errors import SolverError
from ..nlp import Instances, Nlp
from ..sets import PlanarSets
from ..solution import BatchSolution, Status
from . import spectral_core
from .base import VIOLATION, Answer, Solver, require

_WORDS = {
    spectral_core.CONVERGED: (Status.SOLVED, "stationary to tolerance"),
    spectral_core.EXHAUSTED: (Status.ITERATION_LIMIT, "iterations exhausted"),
    spectral_core.STALLED: (Status.FAILED, "no decrease along the projected gradient"),
    spectral_core.NOT_FINITE: (Status.FAILED, "objective or gradient not finite"),
}
_SHARE = 256  # instances that are worth a thread
_SPREAD = 0.5  # of further starts, in radii of the smallest disc


@dataclass(frozen=True)
class SpectralProjectedGradient(Solver):
    """SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000), state by state.

    For problems on products of boxes and discs whose objective is there as source
    (`Nlp.compiled`). The loop is compiled once for every kind of objective and kept on disk.

    Parameters
    ----------
    tolerance : float
        A point x has converged when no component of x - P(x - grad f(x)) is larger, all in
        `Instances.units`: an answer does not depend on the scenario's units.
    iterations : int
        Limit for every start.
    starts : int
        Starts of every instance of a problem that is multimodal (`Nlp.multimodal`): the given one
        and others around it, the same for every state. The least objective is kept.
    """

    tolerance: float = 1e-7
    iterations: int = 300
    starts: int = 4

    name: ClassVar[str] = "spectral"
    summary: ClassVar[str] = (
        "compiled spectral projected gradient, in batches; boxes and discs only"
    )

    def __post_init__(self) -> None:
        require(self, "tolerance", 0 < self.tolerance < np.inf, "a finite number above zero")
        require(self, "iterations", self.iterations >= 1, "whole numbers from 1")
        require(self, "starts", self.starts >= 1, "whole numbers from 1")

    @staticmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Whether the objective is there as source and the constraints as sets."""
        return nlp.compiled is not None and instances.sets is not None

    def _build(self, nlp: Nlp) -> None:
        if nlp.compiled is not None:
            _module(nlp)

    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        run = _Run.of(self, nlp, instances)
        run.solve()
        return [
            Answer(
                run.x[i],
                *_WORDS[int(run.outcome[i])],
                iterations=int(run.counts[i, 0]),
                evaluations=int(run.counts[i, 1]),
                seconds=run.seconds / len(instances),
            )
            for i in range(len(instances))
        ]

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; residuals are recomputed for the whole batch at once.

        Stationarity is the largest component of x - P(x - grad f(x)), in `Instances.units`; it
        needs no multipliers.
        """
        self._build(nlp)
        run = _Run.of(self, nlp, instances)
        run.solve()
        objective, violation, stationarity = self.residuals(nlp, instances, run.x)
        success = (violation <= VIOLATION) & (run.outcome == spectral_core.CONVERGED)
        return BatchSolution(
            x=run.x,
            objective=objective,
            success=success,
            violation=violation,
            stationarity=stationarity,
            resolved=np.zeros(len(instances), bool),
            seconds=run.seconds,
        )

    @staticmethod
    def residuals(nlp: Nlp, instances: Instances, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Objective, violation and stationarity (B,) of points x (B, nx), from the problem alone.

        Stationarity is NaN, and violation infinite, where the functions are not finite.
        """
        assert nlp.compiled is not None
        assert instances.sets is not None
        objective, stationarity = np.empty(len(x)), np.empty(len(x))
        _module(nlp).residual_batch(
            np.ascontiguousarray(x),
            np.ascontiguousarray(instances.parameters),
            nlp.compiled.shared,
            _units(instances),
            *_contiguous(instances.sets),
            objective,
            stationarity,
        )
        points = x.reshape(*instances.sets.shape, 2)
        violation = instances.sets.violation(points).max(axis=1, initial=0.0)
        violation[~np.isfinite(x).all(axis=1) | ~np.isfinite(objective)] = np.inf
        return objective, violation, stationarity


@dataclass
class _Run:
    """The arrays of one batch, contiguous as compiled code wants them."""

    solver: SpectralProjectedGradient
    module: ModuleType
    shared: Floats
    units: Floats
    starts: Floats
    parameters: Floats
    sets: tuple[Floats, Floats, Floats, Floats]
    x: Floats
    objective: Floats
    residual: Floats
    outcome: Counts
    counts: Counts
    seconds: float = 0.0

    @classmethod
    def of(cls, solver: SpectralProjectedGradient, nlp: Nlp, instances: Instances) -> _Run:
        if nlp.compiled is None or instances.sets is None:
            raise SolverError(
                f"spectral cannot take {nlp.name}: it needs a compiled objective (rates made of "
                "kernels) and constraints that are products of boxes and discs"
            )
        sets, batch = instances.sets, len(instances)
        return cls(
            solver=solver,
            module=_module(nlp),
            shared=nlp.compiled.shared,
            units=_units(instances),
            starts=_starts(instances, solver.starts if nlp.multimodal else 1),
            parameters=np.ascontiguousarray(instances.parameters),
            sets=_contiguous(sets),
            x=np.empty_like(instances.start),
            objective=np.empty(batch),
            residual=np.empty(batch),
            outcome=np.empty(batch, np.int64),
            counts=np.zeros((batch, 2), np.int64),
        )

    def solve(self) -> None:
        """Fill x, objective, residual, outcome and counts; each state alone, on any thread."""
        started = time.perf_counter()

        def share(first: int, last: int) -> None:
            self.module.minimise_batch(
                first,
                last,
                self.starts,
                self.parameters,
                self.shared,
                self.units,
                *self.sets,
                self.solver.tolerance,
                self.solver.iterations,
                self.x,
                self.objective,
                self.residual,
                self.outcome,
                self.counts,
            )

        _shared_out(share, len(self.x))
        self.seconds = time.perf_counter() - started


def _units(instances: Instances) -> Floats:
    """Units of x and f, (B, 2); ones where none are given."""
    units = np.ones((len(instances), 2)) if instances.units is None else instances.units
    return np.ascontiguousarray(units)


def _contiguous(sets: PlanarSets) -> tuple[Floats, Floats, Floats, Floats]:
    """The arrays of sets as compiled code wants them."""
    return (
        np.ascontiguousarray(sets.lower),
        np.ascontiguousarray(sets.upper),
        np.ascontiguousarray(sets.centers),
        np.ascontiguousarray(sets.radii),
    )


def _shared_out(work: Callable[[int, int], None], size: int) -> None:
    threads = min(os.cpu_count() or 1, size // _SHARE)
    if threads < 2:
        work(0, size)
        return
    ends = np.linspace(0, size, 4 * threads + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, ends[:-1], ends[1:]))


def _starts(instances: Instances, number: int) -> Floats:
    """Starts (S, B, nx): the given one, and others around it that depend on the state alone."""
    starts = np.repeat(instances.start[None], number, axis=0)
    if number > 1:
        assert instances.sets is not None
        radius = instances.sets.radii.min(axis=-1, initial=np.inf)
        spread = _SPREAD * np.where(np.isfinite(radius), radius, 0.0)
        points = starts.reshape(number, *radius.shape, 2)  # a view
        # one pattern for all states, so that a state's answer does not depend on its batch
        pattern = np.random.default_rng(0).normal(size=(number - 1, 1, radius.shape[1], 2))
        points[1:] += spread[..., None] * pattern
    return starts


def _module(nlp: Nlp) -> ModuleType:
    assert nlp.compiled is not None
    return compiled_module(nlp.compiled.source, inspect.getsource(spectral_core))

"""The spectral projected gradient for objectives that are no source: CasADi's `Function.map`.

The method of `spectral_core` without its Newton steps, with the same starts, steps, tolerances and
outcomes. All instances advance together, a trial point each at a time, and leave when they end:
what costs is the gradient that CasADi evaluates, so the rest is arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray
from ...feasible_sets.planar import PlanarSets
from ...problem import Nlp
from ..casadi_map import gradients
from .spg_kernels import (
    COARSE,
    CONVERGED,
    EXHAUSTED,
    LONGEST,
    MEMORY,
    NOT_FINITE,
    OWN,
    SHORTEST,
    STALLED,
    SUFFICIENT,
)

_TRIALS = 60  # of a step's length
_MAX = 300  # iterations: what takes more is sooner solved by a general solver


@dataclass
class Lanes:
    """The instances that have not ended, a row each."""

    row: IntArray  # which instance
    x: FloatArray
    f: FloatArray
    gradient: FloatArray
    direction: FloatArray
    slope: FloatArray
    length: FloatArray  # of the next trial, as a part of the direction
    trials: IntArray
    steps: FloatArray  # (B, n): the spectral step of every member
    history: FloatArray  # (B, MEMORY): objectives of the last points

    def only(self, which: BoolArray) -> Lanes:
        """Some of them."""
        return Lanes(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Batch:
    """The instances: parameters (B, np), sets of shape (B, n), units (B, 2)."""

    nlp: Nlp
    parameters: FloatArray
    sets: PlanarSets
    units: FloatArray

    @property
    def metric(self) -> FloatArray:
        """Step of one unit of x for one unit of f, (B,)."""
        return self.units[:, 0] ** 2 / self.units[:, 1]

    def evaluate(self, x: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Objectives and gradients."""
        return gradients(self.nlp, x, self.parameters[rows])

    def project(self, x: FloatArray, rows: IntArray) -> FloatArray:
        """Nearest points of the sets; NaN where x is not finite."""
        return self.sets[rows].project(x.reshape(len(x), x.shape[1] // 2, 2)).reshape(x.shape)

    def projected_steps(
        self, x: FloatArray, gradient: FloatArray, steps: FloatArray, rows: IntArray
    ) -> FloatArray:
        """P(x - steps gradient) - x, a step a member."""
        return self.project(x - np.repeat(steps, 2, axis=1) * gradient, rows) - x

    def residuals(self, x: FloatArray, gradient: FloatArray, rows: IntArray) -> FloatArray:
        """P(x - gradient) - x in units, (B, nx)."""
        steps = np.broadcast_to(self.metric[rows, None], (len(x), x.shape[1] // 2))
        return self.projected_steps(x, gradient, steps, rows) / self.units[rows, :1]


def minimise_batch(
    batch: Batch, starts: FloatArray, tolerance: float, iterations: int
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Solve from every start (S, B, nx), coarsely, and from the best of the ends to tolerance.

    Returns x (B, nx), judged (B, 3): f, violation, stationarity; outcome (B,); counts (B, 2).
    """
    iterations = min(iterations, _MAX)
    counts = np.zeros((starts.shape[1], 2), np.int64)
    start = starts[0]
    if len(starts) > 1:
        ends = [_minimise(batch, x, COARSE, iterations, counts) for x in starts]
        usable = [np.where(how == NOT_FINITE, np.inf, f) for _, f, how in ends]
        best = np.argmin(usable, axis=0)
        start = np.stack([x for x, _, _ in ends])[best, np.arange(len(best))]
    x, _, outcome = _minimise(batch, start, tolerance, iterations, counts)
    return x, _judge(batch, x), outcome, counts


def _minimise(
    batch: Batch, start: FloatArray, tolerance: float, iterations: int, counts: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """SPG2 from `start`: x, f and how it ended; adds to the counts of steps and evaluations."""
    rows = np.arange(len(start))
    x = batch.project(start, rows)
    f, gradient = batch.evaluate(x, rows)
    counts[:, 1] += 1
    lanes = Lanes(
        row=rows,
        x=x,
        f=f,
        gradient=gradient,
        direction=np.zeros_like(x),
        slope=np.zeros(len(x)),
        length=np.ones(len(x)),
        trials=np.zeros(len(x), np.int64),
        steps=np.repeat(batch.metric[:, None], x.shape[1] // 2, axis=1),
        history=np.repeat(f[:, None], MEMORY, axis=1),
    )
    longest = _longest(batch.residuals(x, gradient, rows))
    lanes.steps /= np.where(longest > 0, longest, 1.0)[:, None]  # at first a step of about one unit
    ends = x.copy(), f.copy(), np.full(len(x), EXHAUSTED)
    spent = counts[:, 0].copy()
    turned = np.ones(len(x), bool)  # whose direction is to be found
    while lanes.row.size:
        ended = _turn(batch, lanes, turned, tolerance)
        ended[lanes.trials >= _TRIALS] = STALLED
        ended[(ended < 0) & turned & (counts[lanes.row, 0] - spent[lanes.row] >= iterations)] = (
            EXHAUSTED
        )
        left = ended >= 0
        for whole, part in zip(ends, (lanes.x, lanes.f, ended), strict=True):
            whole[lanes.row[left]] = part[left]
        lanes = lanes.only(~left)
        turned = _trial(batch, lanes, counts)
    return ends


def _turn(batch: Batch, lanes: Lanes, which: BoolArray, tolerance: float) -> IntArray:
    """New directions of some lanes; how each lane has ended, -1 where it has not."""
    part = lanes.only(which)
    direction = batch.projected_steps(part.x, part.gradient, part.steps, part.row)
    slope = (direction * part.gradient).sum(axis=1)
    residual = _longest(batch.residuals(part.x, part.gradient, part.row))
    ended = np.full(len(lanes.row), -1)
    ended[which] = np.where(residual <= tolerance, CONVERGED, -1)
    ended[which] = np.where(np.isfinite(part.f) & np.isfinite(slope), ended[which], NOT_FINITE)
    lanes.direction[which], lanes.slope[which] = direction, slope
    lanes.length[which], lanes.trials[which] = 1.0, 0
    return ended


def _trial(batch: Batch, lanes: Lanes, counts: IntArray) -> BoolArray:
    """Try a point in every lane, and move where it is taken: where that is."""
    following = lanes.x + lanes.length[:, None] * lanes.direction
    f, gradient = batch.evaluate(following, lanes.row)
    counts[lanes.row, 1] += 1
    promised = lanes.length * lanes.slope
    taken: BoolArray = np.asarray(f <= lanes.history.max(axis=1) + SUFFICIENT * promised)
    with np.errstate(all="ignore"):  # not finite where f is not, and then not taken
        shorter = -0.5 * lanes.length * promised / (f - lanes.f - promised)
    inside = (shorter >= 0.1 * lanes.length) & (shorter <= 0.9 * lanes.length)
    lanes.length = np.where(inside, shorter, 0.5 * lanes.length)
    lanes.trials += 1
    moved = following[taken] - lanes.x[taken]
    changed = gradient[taken] - lanes.gradient[taken]
    lanes.steps[taken] = _spectral_steps(moved, changed, batch.metric[lanes.row[taken]])
    lanes.x[taken], lanes.f[taken], lanes.gradient[taken] = (
        following[taken],
        f[taken],
        gradient[taken],
    )
    lanes.history[taken] = np.column_stack([lanes.history[taken, 1:], f[taken]])
    counts[lanes.row[taken], 0] += 1
    return taken


def _spectral_steps(moved: FloatArray, changed: FloatArray, metric: FloatArray) -> FloatArray:
    """Every member's inverse curvature, (B, n), within a factor OWN of that of all."""

    def inverse(moves: FloatArray, curves: FloatArray, otherwise: FloatArray) -> FloatArray:
        return np.where(curves > 0, moves / np.where(curves > 0, curves, 1.0), otherwise)

    moves, curves = (
        np.add.reduceat(product, np.arange(0, moved.shape[1], 2), axis=1)
        for product in (moved * moved, moved * changed)
    )
    common = inverse(moves.sum(axis=1), curves.sum(axis=1), LONGEST * metric)
    common = np.clip(common, SHORTEST * metric, LONGEST * metric)[:, None]
    own = inverse(moves, curves, np.broadcast_to(common, moves.shape))
    return np.clip(own, common / OWN, common * OWN)


def _longest(vectors: FloatArray) -> FloatArray:
    """Length of the longest member's part, of each of (B, nx)."""
    parts = vectors.reshape(len(vectors), vectors.shape[1] // 2, 2)
    return np.asarray(np.hypot(parts[..., 0], parts[..., 1]).max(axis=1))


def _judge(batch: Batch, x: FloatArray) -> FloatArray:
    """f, violation and stationarity of points, anew."""
    rows = np.arange(len(x))
    f, gradient = batch.evaluate(x, rows)
    with np.errstate(invalid="ignore"):
        violation = batch.sets.violation(x.reshape(len(x), -1, 2)).max(axis=1)
    stationarity = np.abs(batch.residuals(x, gradient, rows)).max(axis=1)
    finite = np.isfinite(f) & np.isfinite(violation)
    return np.column_stack(
        [f, np.where(finite, violation, np.inf), np.where(finite, stationarity, np.nan)]
    )

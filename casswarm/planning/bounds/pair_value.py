"""The optimal value of two members: proven upper bounds by dynamic programming.

The proof is in ``docs/two-members.md``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...typing import BoolArray, FloatArray
from .grid import Relaxation
from .pair_nodes import PairLattice, Rectangle, pair_lattice

_TILE = 64  # columns at once in a running maximum
_MARGIN = 1.5  # for the density 1 / (1 + d): distance at which a member that stays behind leaves


@dataclass(frozen=True, eq=False)
class Tube:
    """Positions of two members that a policy worth considering may visit.

    Parameters
    ----------
    low, high : (N+1, 2, 2)
        Corners of a rectangle for every step and member, relative to the first member's start.
    back_low, back_high : (N+1, 2)
        Corners of the rectangle outside which a member leaves the problem: it is out of reach of
        the target, by more than a margin.
    leaving : (N, 2) bool
        Whether member i may leave between steps t and t + 1.
    """

    low: FloatArray
    high: FloatArray
    back_low: FloatArray
    back_high: FloatArray
    leaving: BoolArray

    @classmethod
    def full(cls, task: Relaxation, starts: FloatArray, margin: float) -> Tube:
        """All positions within reach of the starts, and almost within reach of the target."""
        steps = np.arange(task.steps + 1)[:, None]
        slack = task.radius + (task.steps - steps) * task.step + margin
        center = task.center - task.start
        back_low, back_high = center - slack, center + slack
        out = steps[..., None] * task.step
        low = np.maximum((starts - task.start) - out, back_low[:, None])
        high = np.minimum((starts - task.start) + out, back_high[:, None])
        return cls(low, high, back_low, back_high, np.ones((task.steps, 2), bool))

    def rectangles(self, spacing: float) -> list[tuple[Rectangle, Rectangle]]:
        """Nodes of the cells of both members, for every step."""
        low = np.floor(self.low / spacing).astype(int)
        high = np.maximum(np.ceil(self.high / spacing).astype(int), low + 1)
        pairs = np.stack([low, high], axis=2).tolist()
        return [
            (Rectangle(tuple(a[0]), tuple(a[1])), Rectangle(tuple(b[0]), tuple(b[1])))
            for a, b in pairs
        ]


def box_maximum(
    values: FloatArray, at: tuple[Rectangle, Rectangle], to: tuple[Rectangle, Rectangle], reach: int
) -> FloatArray:
    """Largest value within reach along all four axes, at the nodes of other rectangles."""
    from .pair_kernels import window_maximum

    for axis in (3, 2, 1, 0):
        member, along = divmod(axis, 2)
        shape = list(values.shape)
        outer, count, inner = int(np.prod(shape[:axis])), shape[axis], int(np.prod(shape[axis + 1 :]))
        shape[axis] = to[member].shape[along]
        out = np.empty(shape)
        first = to[member].low[along] - at[member].low[along]
        scratch = np.empty((2, count, min(_TILE, inner)))
        window_maximum(
            values.reshape(outer, count, inner),
            out.reshape(outer, shape[axis], inner),
            first,
            reach,
            scratch,
        )
        values = out
    return values


class PairProgram:
    def __init__(self, task, starts, tube, reach, margin):
        self.task, self.starts, self.tube, self.reach, self.margin = task, starts, tube, reach, margin
        h = task.step / reach
        self.h = h
        self.rects = tube.rectangles(h)
        lows = np.array([[r.low for r in p] for p in self.rects]).min(axis=(0, 1))
        highs = np.array([[r.high for r in p] for p in self.rects]).max(axis=(0, 1))
        self.region = Rectangle(tuple(lows.tolist()), tuple(highs.tolist()))
        self.size = sum(int(np.prod(a.shape)) * int(np.prod(b.shape)) for a, b in self.rects)
        self.lattice = pair_lattice(task, starts, reach, self.region, round(margin / h))

    def backward(self, keep):
        from .pair_kernels import step_back

        N = self.task.steps
        a, b = self.rects[N]
        values = np.zeros((*a.shape, *b.shape))
        kept = []
        for t in range(N - 1, -1, -1):
            at = self.rects[t + 1]
            step_back(
                self.lattice.member(t + 1, at[0]),
                self.lattice.member(t + 1, at[1]),
                self.lattice.pair,
                self.lattice.offset(*at),
                values,
            )
            if keep:
                kept.append(values)
            values = box_maximum(values, at, self.rects[t], self.reach)
            for member in (0, 1):
                self.leave(t, member, values)
        return values, kept[::-1]

    def leaves(self, t, member):
        rect = self.rects[t][member]
        low = np.ceil(self.tube.back_low[t + 1] / self.h) + self.reach
        high = np.floor(self.tube.back_high[t + 1] / self.h) - self.reach
        x, y = (np.arange(rect.low[a], rect.high[a] + 1) for a in (0, 1))
        ox, oy = (x <= low[0]) | (x >= high[0]), (y <= low[1]) | (y >= high[1])
        return ox[:, None] | oy

    def leave(self, t, member, values):
        if not self.tube.leaving[t, member]:
            return
        out = self.leaves(t, member)
        if not out.any():
            return
        other = self.rects[t][1 - member]
        g = self.lattice.guarded[t][other.within(self.lattice.region)]
        if member == 1:
            values[:, :, out] = np.maximum(values[:, :, out], g[:, :, None])
        else:
            values[out] = np.maximum(values[out], g)

    def bound(self, first):
        """Geometric interpolation at the starts."""
        frac = (self.starts[1] - self.task.start) / self.h
        low = np.array(self.rects[0][1].low)
        low1 = -np.array(self.rects[0][0].low)
        v = first[low1[0], low1[1]]
        w = frac - low
        tot = 0.0
        for i in (0, 1):
            for j in (0, 1):
                weight = (w[0] if i else 1 - w[0]) * (w[1] if j else 1 - w[1])
                if weight > 1e-9:
                    tot += weight * np.log(v[i, j]) if v[i, j] > 0 else -np.inf
        return float(np.exp(tot))

    def forward(self, kept, least):
        from .pair_kernels import step_forward

        N = self.task.steps
        a, b = self.rects[0]
        needed = np.full((*a.shape, *b.shape), -least)
        low, high = self.tube.low.copy(), self.tube.high.copy()
        leaving = np.zeros((N, 2), bool)
        for t in range(N):
            for member in (0, 1):
                if self.tube.leaving[t, member]:
                    out = self.leaves(t, member)
                    if out.any():
                        g = self.lattice.guarded[t][self.rects[t][1 - member].within(self.lattice.region)]
                        T = -needed[:, :, out] if member == 1 else -needed[out]
                        leaving[t, member] = (T <= (g[:, :, None] if member == 1 else g)).any()
            to = self.rects[t + 1]
            needed = box_maximum(needed, self.rects[t], to, self.reach)
            viable = -needed <= kept[t]
            needed[~viable] = -np.inf
            for member in (0, 1):
                axes = (2, 3) if member == 0 else (0, 1)
                m = viable.any(axis=axes)
                for ax in (0, 1):
                    ix = np.flatnonzero(m.any(axis=1 - ax))
                    if ix.size == 0:
                        return None
                    base = to[member].low[ax]
                    low[t + 1, member, ax] = max(low[t + 1, member, ax], (base + ix[0] - 1) * self.h)
                    high[t + 1, member, ax] = min(high[t + 1, member, ax], (base + ix[-1] + 1) * self.h)
            step_forward(
                self.lattice.member(t + 1, to[0]),
                self.lattice.member(t + 1, to[1]),
                self.lattice.pair,
                self.lattice.offset(*to),
                needed,
            )
        return Tube(low, high, self.tube.back_low, self.tube.back_high, leaving)

    def path(self, kept):
        """Greedy path on nodes."""
        pos = self.starts - self.task.start
        out = [pos.copy()]
        for t in range(self.task.steps):
            at = self.rects[t + 1]
            sl = []
            for m in (0, 1):
                for a in (0, 1):
                    lo = int(np.ceil((pos[m, a] - self.task.step) / self.h - 1e-9)) - at[m].low[a]
                    hi = int(np.floor((pos[m, a] + self.task.step) / self.h + 1e-9)) - at[m].low[a]
                    sl.append(slice(max(lo, 0), hi + 1))
            w = kept[t][tuple(sl)]
            ix = np.unravel_index(w.argmax(), w.shape)
            n = np.array([s.start + i for s, i in zip(sl, ix)]).reshape(2, 2) + np.array([r.low for r in at])
            pos = n * self.h
            out.append(pos.copy())
        return np.array(out) + self.task.start

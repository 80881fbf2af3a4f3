"""Instances of the joint plan as numbers, with derivatives from compiled steps.

The program of `casswarm.problems.joint`, for rates that are made of kernels. In the positions all
but the recursion is local to a step, and so are limits of acceleration in the velocities; sums over
later steps lead from one to the other. Second derivatives between steps are not formed: Newton's
equations are solved step by step (`casswarm.joint.riccati_kernels`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from typing_extensions import override

from .._util.threads import locked_cache
from ..compiled.kernels import contiguous
from ..compiled.parallel import execute
from ..hazard import (
    Hazard,
    KernelHazard,
    LocalRates,
    blocked,
    radar_table,
    set_rates,
    unblocked,
)
from ..nlp.program import Nlp
from ..problems.joint import CERTAIN, TINY, JointForm, joint_nlp
from ..solvers.interior_point.derivatives import (
    Condensation,
    Linearisation,
    NumericDerivatives,
    Problems,
)
from ..solvers.interior_point.factors import Factors, shifts_to_try
from ..typing import FloatArray, IntArray
from .derivative_kernels import Derivatives, Steps, differentiate
from .riccati_kernels import Factor, Stages, factorise, solve
from .set_kernels import recursion


def backward_sums(steps: FloatArray) -> FloatArray:
    """Sums over an entry and all later ones of axis 1: from positions to velocities."""
    return np.asarray(steps[:, ::-1].cumsum(axis=1)[:, ::-1])


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints of b instances at a point each: squared lengths of these differences.

    Those of velocities join two steps, those of positions are in one. Blocks are in the order of
    the program.
    """

    names: Sequence[str]  # of acceleration, arrival, outside, separation; the first two at least
    changes: FloatArray  # (b, T, n, 2), of velocity, in every step
    to_center: FloatArray  # (b, T, n, 2), from the target's centre
    arrivals: FloatArray  # (b, T, n), 1 at a member's arrival step, else 0

    @classmethod
    def at(
        cls, names: Sequence[str], velocities: FloatArray, p: Mapping[str, FloatArray]
    ) -> Constraints:
        """Constraints at velocities (b, T, n, 2) with parameters (b, ...) by name."""
        first = p["initial_velocities"].reshape(velocities[:, :1].shape)
        start = p["start"].reshape(first.shape)
        changes = np.diff(velocities, axis=1, prepend=first)
        positions = start + np.cumsum(velocities, axis=1)
        return cls(names, changes, positions - p["center"][:, None], p["arrivals"])

    @property
    def values(self) -> FloatArray:
        """All rows of g."""
        return self._products(self.changes, self.to_center)

    def times(self, velocities: FloatArray) -> FloatArray:
        """Change of all rows with a change (b, T, n, 2) of the velocities."""
        positions = np.cumsum(velocities, axis=1)
        return 2.0 * self._products(np.diff(velocities, axis=1, prepend=0.0), positions)

    def transposed_times(self, rows: FloatArray) -> FloatArray:
        """Gradients (b, T, n, 2) of the sums of all rows with some weights."""
        changes, points, pairs = self._split(rows)
        by_position = points[..., None] * self.to_center
        by_position += self._incidence.T @ (pairs[..., None] * self._pairs(self.to_center))
        by_velocity = backward_sums(by_position)
        by_change = changes[..., None] * self.changes
        by_velocity += by_change
        by_velocity[:, :-1] -= by_change[:, 1:]
        return 2.0 * by_velocity

    def curvature(self, rows: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Second derivatives of the rows' sum, plus weighted squares of first derivatives.

        Blocks (b, T, 2n, 2n) of every step: in the positions, and in the changes of velocity.
        """
        b, steps, n, _ = self.changes.shape
        (changes, points, pairs), squares = self._split(rows), self._split(weights)
        members = np.arange(n)
        in_changes = np.zeros((b, steps, n, 2, n, 2))
        in_changes[:, :, members, :, members] = _block(changes, squares[0], self.changes)
        in_positions = np.zeros_like(in_changes)
        in_positions[:, :, members, :, members] = _block(points, squares[1], self.to_center)
        if pairs.size:
            blocks = _block(pairs, squares[2], self._pairs(self.to_center))
            signs = self._incidence
            in_positions += np.einsum("pi,pj,pbtac->btiajc", signs, signs, blocks)
        shape = b, steps, 2 * n, 2 * n
        return in_positions.reshape(shape), in_changes.reshape(shape)

    @property
    def _incidence(self) -> FloatArray:
        """Matrix (pairs, n) that takes differences of members' points, if they are constrained."""
        n = self.changes.shape[2] if "separation" in self.names else 0
        first, second = np.triu_indices(n, 1)
        members = np.eye(self.changes.shape[2])
        return np.asarray(members[first] - members[second])

    def _pairs(self, points: FloatArray) -> FloatArray:
        """Differences (b, T, pairs, 2) of members' points."""
        return np.asarray(self._incidence @ points)

    def _products(self, changes: FloatArray, points: FloatArray) -> FloatArray:
        """All rows, of products of the differences with others (b, T, n, 2)."""
        outside = _dot(self.to_center, points)
        blocks = {
            "acceleration": _dot(self.changes, changes),
            "arrival": (self.arrivals * outside).sum(axis=1),
            "outside": outside,
            "separation": _dot(self._pairs(self.to_center), self._pairs(points)),
        }
        return np.hstack([blocks[name].reshape(len(points), -1) for name in self.names])

    def _split(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights of rows by what they multiply: changes, points (b, T, n), pairs (b, T, pairs)."""
        b, steps, n, _ = self.changes.shape
        size = steps * n
        points = self.arrivals * rows[:, None, size : size + n]
        rest = rows[:, size + n :]
        if "outside" in self.names:
            points, rest = points + rest[:, :size].reshape(points.shape), rest[:, size:]
        return rows[:, :size].reshape(points.shape), points, rest.reshape(b, steps, -1)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...a,...a->...", a, b))


def _block(rows: FloatArray, weights: FloatArray, vectors: FloatArray) -> FloatArray:
    """Blocks (k, b, T, 2, 2) of squared lengths of vectors (b, T, k, 2), as in `curvature`."""
    outer = 4.0 * weights[..., None, None] * vectors[..., :, None] * vectors[..., None, :]
    return np.asarray((2.0 * rows[..., None, None] * np.eye(2) + outer).transpose(2, 0, 1, 3, 4))


_FACTORISED, _SOLVED = 2**12, 2**15  # sets, of all steps, that are worth a thread
_DIFFERENTIATED = 2**7  # sets, of blocks of steps


class StageFactors(Factors):
    """Factors of the models of b plans; `shifts` (b, m) of the diagonals are tried in order."""

    def __init__(self, stages: Stages, shifts: FloatArray) -> None:
        batch, steps, width = stages.limits.shape
        gains = np.empty((batch, steps, width, stages.terminal.shape[1] + 2 * width))
        self._stages = stages
        self._factors = Factor(np.empty((batch, steps, width, width)), gains)
        self._sets = math.prod(stages.by_set.shape[1:3])  # of all steps
        self.shifts = np.empty(batch)
        arguments = shifts, stages, self._factors, self.shifts
        execute(factorise, batch, arguments, _FACTORISED // self._sets)

    @override
    def solve(self, right: FloatArray) -> FloatArray:
        solution = np.array(right.T, order="C").reshape(self._stages.limits.shape)
        arguments = self._stages, self._factors, solution
        execute(solve, len(solution), arguments, _SOLVED // self._sets)
        return contiguous(solution.reshape(len(solution), -1).T)


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates along plans: a hazard, and the radars (T, r, 3, 1) of every step if they differ."""

    hazard: KernelHazard
    by_step: FloatArray | None

    @classmethod
    def of(cls, hazard: Hazard, form: JointForm) -> Rates | None:
        """Rates of a plan's steps; None for those that are not made of kernels."""
        steps = [hazard.after(form.first + t + 1) for t in range(form.horizon)]
        if not isinstance(steps[0], KernelHazard):
            return None
        return cls(steps[0], radar_table(*steps) if hazard.changes else None)  # type: ignore[arg-type]

    def radars(self, batch: int) -> FloatArray | None:
        """Radars of the blocks (k, r, 3, LANES) of b plans, None if they are the hazard's own."""
        if self.by_step is None:
            return None
        shape = batch, *self.by_step.shape[:-1]
        return in_blocks(np.broadcast_to(self.by_step[..., 0], shape))


@locked_cache(maxsize=64)
def joint_program(
    hazard: Hazard | tuple[Hazard, ...], form: JointForm, hessian: bool = True
) -> Nlp:
    """The program of `joint_nlp`, with these derivatives if the rates are made of kernels."""
    nlp = joint_nlp(hazard, form, hessian)
    hazards = hazard if isinstance(hazard, tuple) else (hazard,)
    rates = tuple(filter(None, (Rates.of(each, form) for each in hazards)))
    if not (form.exact and len(rates) == len(hazards)):
        return nlp
    numeric = partial(JointNumeric, replace(nlp, attachments=()), rates, form.n)
    return nlp.with_attachments(NumericDerivatives(numeric))


@dataclass(frozen=True, eq=False)
class JointNumeric(Problems):
    """Instances of a joint plan of n members in K cases, with parameters (B, np)."""

    nlp: Nlp
    cases: tuple[Rates, ...]
    n: int
    p: FloatArray

    @override
    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = self._points(rows, x)
        failure = points.mean([points.failure(case) for case in self.cases])
        with np.errstate(invalid="ignore"):
            odds = np.log(failure + TINY) - np.log(1.0 - failure + CERTAIN)
        return odds, contiguous(points.constraints.values.T)

    @override
    def linearise(self, rows: IntArray, x: FloatArray) -> JointLinearisation:
        return JointLinearisation(self._points(rows, x))

    def _points(self, rows: IntArray, x: FloatArray) -> JointPoints:
        p = {name: blocks[rows] for name, blocks in self._parameters.items()}
        velocities = contiguous(x.T).reshape(len(rows), -1, self.n, 2)
        constraints = Constraints.at(tuple(self.nlp.constraints), velocities, p)
        return JointPoints(self.cases, constraints, p)

    @cached_property
    def _parameters(self) -> dict[str, FloatArray]:
        return self.nlp.parameter_blocks(self.p)


@dataclass(frozen=True, eq=False)
class JointPoints:
    """Points of b instances, with their parameters."""

    cases: tuple[Rates, ...]
    constraints: Constraints
    p: dict[str, FloatArray]

    @cached_property
    def blocks(self) -> FloatArray:
        """X(1..T), the steps of all instances in blocks (k, n, 2, LANES)."""
        p = {name: self.p[name][:, None] for name in ("origin", "length", "center")}
        return in_blocks(p["origin"] + p["length"] * (self.constraints.to_center + p["center"]))

    @cached_property
    def prior(self) -> FloatArray:
        """Prior (b, K) of the cases."""
        if len(self.cases) == 1:
            return np.ones((len(self.constraints.changes), 1))
        return self.p["prior"][:, 0]

    def mean(self, values: Sequence[FloatArray]) -> FloatArray:
        """Mean over the cases of values (b, ...) of each."""
        if len(values) == 1:
            return values[0]
        return np.asarray(np.einsum("bk,kb...->b...", self.prior, np.array(values)))

    @cached_property
    def _clock(self) -> FloatArray:
        """The time step of all steps in blocks, (k, LANES)."""
        shape = self.constraints.changes.shape[:2]
        return in_blocks(np.broadcast_to(self.p["clock"][:, :, 0], shape))

    def swept(self, rates: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Probabilities of losses in blocks, F_0 (b, m), masses and functions (b, T, m)."""
        lost = -np.expm1(-self._clock[:, None, None] * rates)
        batch, steps = self.constraints.changes.shape[:2]
        by_step = unblocked(lost, batch * steps)
        ends = self.p["continues"], self.p["costs"], self.p["last_cost"][:, 0]
        return lost, *recursion(by_step.reshape(batch, steps, *by_step.shape[1:]), *ends)

    def failure(self, case: Rates) -> FloatArray:
        """F (b,) in a case."""
        radars = case.radars(len(self.constraints.changes))
        return self.swept(set_rates(case.hazard, self.blocks, None, radars))[1][:, -1]

    def differentiated(self) -> tuple[FloatArray, Derivatives]:
        """F (b,), with its derivatives in all steps, in lengths of a step at v_max.

        Those in the law are of the laws of all cases, one after the other.
        """
        failures, parts = zip(*(self._of_case(k) for k in range(len(self.cases))), strict=True)
        if len(parts) == 1:
            return failures[0], parts[0]
        gradients, hessians, *of_law = zip(*parts, strict=True)
        joined = (np.concatenate(arrays, axis=2) for arrays in of_law)
        sums = (np.sum(arrays, axis=0) for arrays in (gradients, hessians))
        return self.mean(failures), Derivatives(*sums, *joined)

    def _of_case(self, k: int) -> tuple[FloatArray, Derivatives]:
        """F (b,) in a case, and its derivatives, of which those in positions have its weight."""
        case = self.cases[k]
        local = LocalRates.of(case.hazard, self.blocks, case.radars(len(self.prior)))
        lost, failure, masses, after = self.swept(local.rates[:, :, 0])
        masses = masses * self.prior[:, k, None, None]
        (batch, steps, sets), n = masses.shape, lost.shape[2]
        width = 2 * n
        shapes = (width,), (width, width), (sets, width), (sets, width), (3**n,)
        flat = Derivatives(*(np.empty((batch * steps, *shape)) for shape in shapes))
        continues, costs = self.p["continues"].copy(), self.p["costs"].copy()
        continues[..., 0], costs[..., 0] = 0.0, self.p["last_cost"][..., 0]
        of_sets = [in_blocks(part) for part in (masses, after, continues, costs)]
        arrays = lost, *of_sets, self.blocks, local.radars, local.pairs, local.rates
        arguments = Steps._make([self._clock, *arrays]), case.hazard.collides, flat
        execute(differentiate, len(lost), arguments, _DIFFERENTIATED // sets)
        out = Derivatives(*(part.reshape(batch, steps, *part.shape[1:]) for part in flat))
        unit = self.p["length"]
        out.gradient[:] *= unit
        out.by_set[:] *= unit[..., None]
        out.by_outcome[:] *= unit[..., None]
        out.hessian[:] *= unit[..., None] ** 2
        return failure[:, -1], out


def in_blocks(values: FloatArray) -> FloatArray:
    """Values (b, T, ...) of all steps in blocks (k, ..., LANES)."""
    return blocked(values.reshape(-1, *values.shape[2:]))


class JointLinearisation(Linearisation):
    """Derivatives of b instances at a point each."""

    def __init__(self, points: JointPoints) -> None:
        self._constraints, self._last_cost = points.constraints, points.p["last_cost"][:, 0]
        failure, self._steps = points.differentiated()
        below, above = 1.0 / (failure + TINY), 1.0 / (1.0 - failure + CERTAIN)
        self._slope, self._bend = below + above, above**2 - below**2  # of the log-odds
        by_velocity = backward_sums(self._steps.gradient)
        self.gradient = contiguous((self._slope[:, None] * by_velocity.reshape(len(failure), -1)).T)

    @override
    def times(self, vectors: FloatArray) -> FloatArray:
        velocities = contiguous(vectors.T).reshape(self._constraints.changes.shape)
        return contiguous(self._constraints.times(velocities).T)

    @override
    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        by_velocity = self._constraints.transposed_times(contiguous(vectors.T))
        return contiguous(by_velocity.reshape(len(by_velocity), -1).T)

    @override
    def row_sizes(self) -> FloatArray:
        size, batch = self._constraints.values.shape[1], self.gradient.shape[1]
        rows = (np.tile(unit[:, None], batch) for unit in np.eye(size))
        return np.array([abs(self.transposed_times(row)).max(axis=0, initial=0.0) for row in rows])

    @override
    def factors(self, terms: Condensation, last: FloatArray) -> StageFactors:
        steps, size = self._steps, len(self.gradient)
        multipliers, weights = contiguous(terms.multipliers.T), contiguous(terms.weights.T)
        positions, changes = self._constraints.curvature(multipliers, weights[:, size:])
        slope, terminal = terms.objective * self._slope, self._last_cost.copy()
        terminal[:, 0] = 1.0
        terminal = np.tile(terminal, (1, steps.by_set.shape[2] // terminal.shape[1]))
        positions += slope[:, None, None, None] * steps.hessian
        limits = contiguous(weights[:, :size]).reshape(steps.gradient.shape)
        of_law = steps.transitions, steps.by_outcome, steps.by_set
        of_objective = slope, terms.objective * self._bend
        stages = Stages(*of_law, positions, changes, limits, terminal, *of_objective)
        return StageFactors(stages, shifts_to_try(last))

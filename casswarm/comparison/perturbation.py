"""Perturbed copies of problems: the same mathematics, posed differently.

The time and the outcome of a solve depend on details that have no meaning, such as the order of the
variables. A copy changes such details at random:

- the initial guess, by noise;
- the order of variables and constraints;
- the units of variables, constraints and objective, by powers of two, which are exact.

With scales s, r, w > 0 and orders, a copy minimises w f(x) over y = x / s, subject to r g(x) within
r times its bounds. An answer is mapped back, x = s y with multipliers lam_g = r lam'_g / w and
lam_x = lam_y / (w s), and verified on the original problem.

A problem in a form that special solvers exploit (`Instances.feasible_set`,
`Nlp.attachments`) keeps it: its copies differ in the initial guess alone.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from .._util.threads import one_at_a_time
from ..nlp.program import Instances, Nlp
from ..solvers import Answer
from ..typing import FloatArray, IntArray
from .problem import Problem

START_NOISE = 0.05
"""Standard deviation of the initial guesses, relative to the larger of |x0| and the length unit."""

SCALE_EXPONENT = 2
"""Scales are powers of two with exponents of at most this size."""


@dataclass(frozen=True, eq=False)
class Reformulation:
    """Order and units of variables and constraints, and the unit of the objective."""

    variables: IntArray  # (nx,), their positions in the original
    constraints: IntArray  # (ng,)
    x_scale: FloatArray  # s, (nx,), in the original's order
    g_scale: FloatArray  # r, (ng,)
    f_scale: float  # w

    @classmethod
    def random(cls, nlp: Nlp, rng: np.random.Generator) -> Reformulation:
        """Random orders and scales."""
        nx, _, ng = nlp.sizes

        def scales(number: int) -> FloatArray:
            exponents = rng.integers(-SCALE_EXPONENT, SCALE_EXPONENT, number, endpoint=True)
            return np.asarray(2.0**exponents)

        return cls(
            rng.permutation(nx), rng.permutation(ng), scales(nx), scales(ng), float(scales(1)[0])
        )

    @one_at_a_time
    def program(self, nlp: Nlp) -> Nlp:
        """The program in the new variables, as one block of variables and one of constraints."""
        y = ca.MX.sym("x", len(self.variables))
        x = ca.DM(self.x_scale) * y[np.argsort(self.variables).tolist()]
        objective, g = ca.Function("original", [nlp.x, nlp.p], [nlp.objective, nlp.g]).call(
            [x, nlp.p], True, False
        )
        rows = (ca.DM(self.g_scale) * g)[self.constraints.tolist()]
        return Nlp(
            name=nlp.name,
            variables={"x": y},
            parameters=nlp.parameters,
            objective=self.f_scale * objective,
            constraints={"g": rows} if len(self.constraints) else {},
            unroll=nlp.unroll,
        )

    def instances(self, original: Instances) -> Instances:
        """The instances in the new variables."""
        return Instances(
            x0=(original.x0 / self.x_scale)[:, self.variables],
            p=original.p,
            lbx=(original.lbx / self.x_scale)[:, self.variables],
            ubx=(original.ubx / self.x_scale)[:, self.variables],
            lbg=(original.lbg * self.g_scale)[:, self.constraints],
            ubg=(original.ubg * self.g_scale)[:, self.constraints],
            scale=original.scale * [1.0, self.f_scale],
        )

    def restored(self, answer: Answer) -> Answer:
        """An answer in the original's variables; unchanged if its sizes are wrong."""
        if np.shape(answer.x) != self.variables.shape:
            return answer
        x = self._unordered(answer.x, self.variables) * self.x_scale
        multipliers = answer.multipliers
        if multipliers is not None:
            bounds = self._unordered(multipliers[0], self.variables) / self.x_scale
            rows = self._unordered(multipliers[1], self.constraints) * self.g_scale
            multipliers = bounds / self.f_scale, rows / self.f_scale
        return replace(answer, x=x, multipliers=multipliers)

    @staticmethod
    def _unordered(values: FloatArray, order: IntArray) -> FloatArray:
        return np.asarray(values, dtype=float)[np.argsort(order)]


@dataclass(frozen=True, eq=False)
class ProblemCopy:
    """A problem as it is posed to solvers, and what maps answers back if its variables differ."""

    problem: Problem  # the original, on which answers are verified
    number: int  # 0 for the original itself
    nlp: Nlp
    starts: Mapping[str, Instances]
    reformulation: Reformulation | None = None

    def restored(self, answer: Answer) -> Answer:
        """An answer of a solver, in the variables of the original."""
        return answer if self.reformulation is None else self.reformulation.restored(answer)


def problem_copies(problems: Sequence[Problem], copies: int, seed: int) -> Iterator[ProblemCopy]:
    """Every problem, followed by its perturbed copies.

    Copies depend on the seed, their number and the problem's name, not on the other problems.
    """
    for problem in problems:
        yield ProblemCopy(problem, 0, problem.nlp, problem.starts)
        name = zlib.crc32(problem.name.encode())
        for number in range(1, copies + 1):
            yield _perturbed(problem, number, np.random.default_rng([seed, 3, name, number]))


def _perturbed(problem: Problem, number: int, rng: np.random.Generator) -> ProblemCopy:
    nlp = problem.nlp
    starts = {name: _other_start(start, rng) for name, start in problem.starts.items()}
    if is_structured(problem):
        return ProblemCopy(problem, number, nlp, starts)
    change = Reformulation.random(nlp, rng)
    changed = {name: change.instances(start) for name, start in starts.items()}
    return ProblemCopy(problem, number, change.program(nlp), changed, change)


def is_structured(problem: Problem) -> bool:
    """Return True if the problem has a form that a special solver can exploit."""
    sets = (start.feasible_set for start in problem.starts.values())
    return bool(problem.nlp.attachments) or any(each is not None for each in sets)


def _other_start(original: Instances, rng: np.random.Generator) -> Instances:
    """Noise on the initial guess, within the bounds on x."""
    unit = np.maximum(np.abs(original.x0), original.scale[:, :1])
    moved = original.x0 + START_NOISE * unit * rng.standard_normal(original.x0.shape)
    return original.with_x0(np.clip(moved, original.lbx, original.ubx))

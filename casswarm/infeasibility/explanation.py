"""Explanations of infeasible programs: a set of rows and bounds that contradict each other.

An elastic program names candidates; a deletion filter, of which all variants are a batch, leaves
an irreducible infeasible subset (J. W. Chinneck, Feasibility and Infeasibility in Optimization,
Springer 2008). Both sides are then verified by residuals that are recomputed from the program.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import casadi as ca
import numpy as np

from .._util.text import counted
from ..comparison import Problem
from ..errors import ProblemError
from ..nlp.program import Instances, NamedRows, Nlp
from ..nlp.residuals import invalid_value
from ..solvers import FilterInteriorPoint, Ipopt
from ..typing import BoolArray, FloatArray
from .elastic import TOLERANCE, ElasticPrograms, Units
from .proof import is_contradiction

_STARTS, _FEW, _MANY = 16, 4, 64  # of the whole program, of variants, of the set that is named
_ROUNDS = 12
_CLEAR = 10.0  # times the tolerance: a smaller violation may be that of a slow method
_INVOLVED = 1e-4  # of the largest violation, above which an entry counts as a candidate


@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a program has no feasible point, or one that it has.

    Parameters
    ----------
    feasible : bool or None
        None where neither a feasible point nor a contradiction could be verified.
    rows : tuple of str
        Names of the rows that contradict each other, together with the bounds of `variables`.
    row_indices : tuple of int
        Their numbers in the user's order, from 0; a constraint of an `Opti` stack is one row.
    variables : tuple of str
        Names of the variables whose bounds are involved.
    point : (nx,)
        A feasible point; otherwise the one at which the rows and bounds named are violated least.
    violation : float
        Largest violation at `point`, absolute: of all rows and bounds, or of those named.
    proven : bool
        Whether the contradiction is proven in exact arithmetic, as it is for linear rows and for
        crossed bounds. Otherwise a local method found no feasible point from any of its starts.
    witnesses : (k, nx)
        For every row named, then for every variable, a point that meets all the others.
    text : str
        The explanation as a paragraph, which ``print`` shows.
    """

    feasible: bool | None
    rows: tuple[str, ...]
    row_indices: tuple[int, ...]
    variables: tuple[str, ...]
    point: FloatArray
    violation: float
    proven: bool
    witnesses: FloatArray
    text: str = field(repr=False)

    def __repr__(self) -> str:
        return (
            f"Explanation(feasible={self.feasible}, rows={self.rows}, variables={self.variables}, "
            f"violation={self.violation:.3g}, proven={self.proven})"
        )

    def __str__(self) -> str:
        return self.text


def explain(
    problem: Problem | Nlp | ca.Opti | Mapping[str, Any],
    instances: Instances | None = None,
    *,
    seed: int = 0,
    **arguments: Any,
) -> Explanation:
    """Find out whether a program is feasible, and otherwise which rows contradict each other.

    The rows and bounds that are named have no common feasible point; without any one of them there
    is one, which is among the `Explanation.witnesses`. The answer does not depend on the
    objective, nor on the units of rows and variables: violations up to 1e-6 of a typical change of
    a row count as none.

    Parameters
    ----------
    problem : Problem, Nlp, casadi.Opti or mapping
        A mapping is a dictionary as `casadi.nlpsol` takes it.
    instances : Instances, optional
        A single instance, of an `Nlp`.
    seed : int
        Of further starts, beside the initial guess.
    **arguments
        Of a dictionary, as in `Problem.from_casadi`.

    Returns
    -------
    Explanation

    Raises
    ------
    ProblemError
        A program without variables, numbers that are NaN, or a problem that cannot be made.
    SolverError
        Arrays of `instances` that do not fit the program.

    Examples
    --------
    >>> import casadi as ca
    >>> import casswarm as csw
    >>> x = ca.SX.sym("x", 2)
    >>> rows = ca.vertcat(ca.sumsqr(x), x[0] + x[1], x[0] - x[1])
    >>> found = csw.explain({"x": x, "g": rows}, lbg=[0, 3, -1], ubg=[1, 9, 1])
    >>> found.feasible, found.row_indices
    (False, (0, 1))
    """
    nlp, instance = _posed(problem, instances, arguments)
    return _Search(nlp, instance, seed).explanation()


def _posed(
    problem: Any, instances: Instances | None, arguments: dict[str, Any]
) -> tuple[Nlp, Instances]:
    """Program and instance of what `explain` takes."""
    if isinstance(problem, ca.Opti):
        problem = Problem.from_opti(problem)
    elif isinstance(problem, Mapping):
        problem, arguments = Problem.from_casadi(problem, **arguments), {}
    if isinstance(problem, Problem):
        problem, instances = problem.nlp, next(iter(problem.starts.values()))
    if not isinstance(problem, Nlp) or instances is None or len(instances) != 1 or arguments:
        message = (
            f"explain got {type(problem).__name__} with {instances!r} and {sorted(arguments)}; "
            "allowed: a Problem, an Opti stack, a dictionary of CasADi with its arguments, or an "
            "Nlp with Instances of a single instance"
        )
        raise ProblemError(message, key="problem", value=repr(problem))
    instances.require_fit(problem)
    for key in ("p", "lbx", "ubx", "lbg", "ubg"):
        if np.isnan(getattr(instances, key)).any():
            raise ProblemError(f"problem {problem.name!r}: {key} has entries that are NaN", key=key)
    if not problem.sizes[0]:
        raise ProblemError(f"problem {problem.name!r} has no variables", problem=problem.name)
    x0 = np.where(np.isfinite(instances.x0), instances.x0, 0.0)
    return problem, instances.with_x0(x0)


class _Search:
    """Search for a smallest contradiction. Sets are masks of members: rows, then bounds."""

    def __init__(self, nlp: Nlp, instance: Instances, seed: int) -> None:
        self.nlp, self.instance, self.seed = nlp, instance, seed
        named = NamedRows.of(nlp)
        self.named, self.n_rows = named, len(named.rows)
        self.low = np.concatenate([instance.lbg[0], instance.lbx[0]])
        self.high = np.concatenate([instance.ubg[0], instance.ubx[0]])
        bounds = self.n_rows + np.arange(nlp.sizes[0])
        self.member = np.concatenate([np.repeat(np.arange(self.n_rows), named.sizes), bounds])
        size, bounded = self.n_rows + nlp.sizes[0], np.isfinite(self.low) | np.isfinite(self.high)
        self.every = np.isin(np.arange(size), self.member[bounded])
        self.centre = np.clip(instance.x0, instance.lbx, instance.ubx)

    def explanation(self) -> Explanation:
        """Explanation of the instance."""
        crossed = np.flatnonzero(
            (self.low > self.high) | (self.low == np.inf) | (self.high == -np.inf)
        )
        if crossed.size:
            some = np.arange(len(self.every)) == self.member[crossed[0]]
            return self._contradiction(some, self.centre[0], self.centre, proven=True)
        units = Units.of(self.nlp, self.instance, self.centre)
        self.programs = ElasticPrograms(self.nlp, self.instance, units)
        self.programs.add(self.centre)
        self._solve([self.every], self._starts(_STARTS))
        if (best := self._feasible(self.every)) is None:
            self._pose(self._best(self.every)[None])  # in units of what is left there
            self._solve([self.every], self._starts(_STARTS // 2, 1))
            best = self._feasible(self.every)
        if best is not None:
            return self._answer(True, best, "feasible: {point} meets all rows and bounds")
        if not np.isfinite(self.programs.violations).all(axis=1).any():
            reason = invalid_value(self.nlp, self.instance, self.centre[0])
            return self._answer(None, self.centre[0], f"undecided: {reason or 'not finite'}")
        return self._smallest()

    def _smallest(self) -> Explanation:
        """Explanation of a program of which no feasible point was found."""
        best = self._best(self.every)
        some = self._candidates(best)
        for _ in range(_ROUNDS):
            grown = self._grown(some)
            if grown is None:
                break
            some = self._reduced(grown)
            if self._feasible(some) is not None:
                continue
            self._solve([some], self._starts(_MANY, 2))
            if not (proven := self._proven(some)):
                self._solve_constrained(some)
            if self._feasible(some) is None and (witnesses := self._witnesses(some)) is not None:
                if not proven and self._largest(some).min() < _CLEAR * TOLERANCE:
                    break
                return self._contradiction(some, self._best(some), witnesses, proven)
        if (point := self._feasible(self.every)) is not None:
            return self._answer(True, point, "feasible: {point} meets all rows and bounds")
        return self._answer(
            None,
            best,
            "undecided: no feasible point was found, and no set of rows could be verified to "
            "contradict each other",
        )

    # --- elastic programs

    def _pose(self, points: FloatArray) -> None:
        """Pose the elastic programs again, in units of some points."""
        self.programs.pose(Units.of(self.nlp, self.instance, points))
        self.programs.add(np.vstack([self.centre, points]))

    def _starts(self, count: int, stream: int = 0) -> FloatArray:
        """Points (count, nx): the initial guess, the best known one, then random ones."""
        rng = np.random.default_rng([self.seed, stream])
        unit, low, high = self.programs.units.x, self.instance.lbx[0], self.instance.ubx[0]
        spread = 10.0 ** rng.uniform(-1.0, 1.0, (count, 1)) * unit
        free = self.centre + spread * rng.standard_normal((count, unit.size))
        finite = np.isfinite(high - low)
        within = np.where(finite, low, 0.0) + np.where(finite, high - low, 0.0) * rng.random(
            free.shape
        )
        points = np.where(finite & (np.arange(count)[:, None] % 2 == 0), within, free)
        points = np.clip(points, low, high)
        points[:2] = np.stack([self.centre[0], self._best(self.every)])[:count]
        return points

    def _solve_constrained(self, some: BoolArray) -> None:
        """Look for points of a set by methods with constraints, which end elsewhere."""
        nlp, instance, mask = self.nlp, self.instance, some[self.member]
        ng, starts = nlp.sizes[2], self._starts(_STARTS // 2, 3)
        rows, box = np.flatnonzero(mask[:ng]), mask[ng:]
        constraints = {"g": nlp.g[rows.tolist()]} if rows.size else {}
        program = Nlp(nlp.name, nlp.variables, nlp.parameters, ca.MX(0), constraints)
        low, high = np.where(box, self.low[ng:], -np.inf), np.where(box, self.high[ng:], np.inf)
        posed = Instances(starts, instance.p[0], low, high, self.low[rows], self.high[rows])
        found = [FilterInteriorPoint(max_iter=60, restoration=False).solve_batch(program, posed).x]
        found += [s.x[None] for s in Ipopt(max_iter=60).solve(program, posed[:2])]
        points = np.vstack(found)
        self.programs.add(points[np.isfinite(points).all(axis=1)])

    def _solve(self, sets: Sequence[BoolArray], starts: FloatArray) -> None:
        """Solve elastic programs of sets, each also from the best point of it that is known."""
        each = np.broadcast_to(starts, (len(sets), *starts.shape)).copy()
        each[:, 1] = [self._best(some) for some in sets]
        self.programs.solve(np.stack(sets)[:, self.member], each)

    def _largest(self, some: BoolArray) -> FloatArray:
        """Largest violation (P,) of a set at every known point."""
        return np.asarray(self.programs.violations[:, some[self.member]].max(axis=1, initial=0.0))

    def _best(self, some: BoolArray) -> FloatArray:
        return np.asarray(self.programs.points[self._largest(some).argmin()])

    def _feasible(self, some: BoolArray) -> FloatArray | None:
        """A known point that meets a set: of these, one that is violated least elsewhere."""
        meets = np.flatnonzero(self._largest(some) <= TOLERANCE)
        if not meets.size:
            return None
        elsewhere = self._largest(self.every)[meets]
        return np.asarray(self.programs.points[meets[elsewhere.argmin()]])

    # --- sets

    def _candidates(self, x: FloatArray) -> BoolArray:
        """Members that are violated at x, and bounds that keep the violation from decreasing."""
        pull = np.concatenate([np.zeros(self.nlp.sizes[2]), self.programs.pull(x)])
        involved = np.maximum(self.programs.add(x[None])[0], pull)
        kept = np.zeros(len(self.every), bool)
        kept[self.member[involved > _INVOLVED * involved.max()]] = True
        return kept & self.every

    def _grown(self, some: BoolArray) -> BoolArray | None:
        """The set with members that feasible points of it violate, until none is found."""
        for _ in range(_ROUNDS):
            self._solve([some], self._starts(_STARTS))
            if (x := self._feasible(some)) is None:
                return some
            more = self.programs.add(x[None])[0] > TOLERANCE
            if not more.any():
                return None
            some = some.copy()
            some[self.member[more]] = True
        return None

    def _reduced(self, some: BoolArray) -> BoolArray:
        """An irreducible subset, by deletion filters whose variants are solved together.

        Members are left out one after the other. The first without which there is a feasible point
        is kept for good, and those before it are not needed. Where that is the first of all, each
        of the others is left out alone, since all may be needed; or the set, of which only local
        minima were known, has a feasible point: it is returned then.
        """
        violations = self.programs.add(self._best(some)[None])[0]
        order = np.zeros(len(self.every))
        np.maximum.at(order, self.member, violations)
        rest = np.flatnonzero(some)
        rest = rest[np.argsort(order[rest], kind="stable")]
        needed, members, stalled = np.zeros_like(some), np.arange(some.size), False
        while rest.size:
            left_out = [rest[j : j + 1] if stalled else rest[: j + 1] for j in range(rest.size)]
            now = needed | np.isin(members, rest)
            sets = [now & ~np.isin(members, each) for each in left_out]
            self._solve(sets, self._starts(max(_FEW, _MANY // len(sets))))
            found = np.array([self._feasible(each) is not None for each in sets])
            first = int(found.argmax()) if found.any() else rest.size
            needed[rest[found] if stalled else rest[first : first + 1]] = True
            rest = rest[~found] if stalled else rest[first + 1 :]
            stalled = not stalled and not first and rest.size > _FEW
            if stalled:
                self._solve_constrained(now)
            if self._feasible(now) is not None:
                return now
        return needed

    def _witnesses(self, some: BoolArray) -> FloatArray | None:
        """For every member a point that meets the others; None if one is not found."""
        sets = [some & (np.arange(some.size) != i) for i in np.flatnonzero(some)]
        if any(self._feasible(each) is None for each in sets):
            self._solve(sets, self._starts(_STARTS))
        found = [self._feasible(each) for each in sets]
        return None if any(x is None for x in found) else np.array(found)

    def _proven(self, some: BoolArray) -> bool:
        """Whether the rows of a set are linear, and exact arithmetic proves the contradiction."""
        entries = np.flatnonzero(some[self.member])
        ng, nx = self.nlp.sizes[2], self.nlp.sizes[0]
        x, p = ca.MX.sym("x", nx), ca.DM(self.instance.p[0])
        g = self.nlp.evaluate(x, p)[1]
        if ng and any(np.array(ca.which_depends(g, x, 2, True))[entries[entries < ng]]):
            return False
        zero = np.zeros(nx)
        constant = np.asarray(self.nlp.evaluate(zero, p)[1]).ravel()
        matrix = np.vstack([self.nlp.jacobian(zero, p).full().reshape(ng, nx), np.eye(nx)])
        constant = np.concatenate([constant, zero])
        with np.errstate(invalid="ignore"):
            low, high = self.low - constant, self.high - constant
        if not np.isfinite(matrix[entries]).all() or not np.isfinite(constant[entries]).all():
            return False
        return is_contradiction(matrix[entries], low[entries], high[entries])

    # --- answers

    def _violation(self, x: FloatArray, some: BoolArray) -> float:
        """Largest violation of a set at x, in the user's units, by the program itself."""
        g = np.asarray(self.nlp.evaluate(x, self.instance.p[0])[1]).ravel()
        values, counts = np.concatenate([g, x]), some[self.member]
        with np.errstate(invalid="ignore"):
            excess = np.maximum(self.low - values, values - self.high)[counts]
        return float(np.where(np.isnan(excess), np.inf, excess).max(initial=0.0))

    def _answer(self, feasible: bool | None, x: FloatArray, text: str) -> Explanation:
        violation = self._violation(x, self.every)
        shown = np.array2string(x, precision=6, threshold=8)
        told = text.format(point=f"the point {shown}")
        text = f"{self.nlp.name} is {told} (largest violation {violation:.2g})."
        none = np.empty((0, x.size))
        return Explanation(feasible, (), (), (), x, violation, False, none, text)

    def _contradiction(
        self, some: BoolArray, x: FloatArray, witnesses: FloatArray, proven: bool
    ) -> Explanation:
        chosen = np.flatnonzero(some)
        rows = chosen[chosen < self.n_rows]
        bounds = chosen[chosen >= self.n_rows] - self.n_rows
        names = tuple(self.named.rows[i] for i in rows)
        variables = tuple(self.named.variables[j] for j in bounds)
        violation = self._violation(x, some)
        text = (
            f"{self.nlp.name} is infeasible: {self._listed(chosen.tolist())} "
            f"{'contradict each other' if len(chosen) > 1 else 'cannot be met'}. "
            f"The least violation found is {violation:.6g}. "
        )
        if proven:
            text += "The contradiction is proven in exact arithmetic. "
        else:
            text += (
                f"Local methods found no feasible point from {_MANY} starts, which is no proof. "
            )
        if len(chosen) > 1:
            text += "Without any one of them, a point that meets all the others was found."
        indices, text = tuple(map(int, rows)), text.strip()
        return Explanation(False, names, indices, variables, x, violation, proven, witnesses, text)

    def _listed(self, members: list[int]) -> str:
        """Descriptions of members; of three or more in a row that are alike, the first and last."""
        names, texts = self.named.rows + self.named.variables, []
        described = [(i, self._described(i)) for i in members]
        keys = {i: (i - k, text.replace(names[i], "")) for k, (i, text) in enumerate(described)}
        for _, group in groupby(described, lambda each: (keys[each[0]], each[0] < self.n_rows)):
            some = [text for _, text in group]
            texts += some if len(some) < 3 else [f"{some[0]} to {some[-1]}"]
        return ", ".join(texts)

    def _described(self, member: int) -> str:
        """Name of a member with its bounds."""
        entries = np.flatnonzero(self.member == member)
        names = self.named.rows + self.named.variables
        if len(entries) > 1:
            return f"{names[member]} ({counted(len(entries), 'entry', 'entries')})"
        low, high = float(self.low[entries[0]]), float(self.high[entries[0]])
        if low == high:
            return f"{names[member]} = {low:g}"
        below = f"{low:g} <= " if np.isfinite(low) else ""
        above = f" <= {high:g}" if np.isfinite(high) else ""
        if not above:
            return f"{names[member]} >= {low:g}"
        return f"{below}{names[member]}{above}"

"""Sets of priors over cases, the worst prior of each, and mixtures that are best against it.

A set Q lies in the simplex of K priors. The least mean of values, min over q in Q of sum_k q_k S_k,
has a closed form for each of them; the best mixture of paths with survivals s_k(w) is a matrix game
over Q, a linear program.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from .._util.numbers import rounded_up
from .._util.text import counted, shown
from ..errors import PlanningError
from ..typing import FloatArray, Interval

Name: TypeAlias = Literal["mean", "worst", "cvar", "tv"]
AmbiguityLike: TypeAlias = Literal["mean", "worst"] | tuple[Literal["cvar", "tv"], float]
"""What `plan` takes: the name of a set of priors, with its parameter if it has one."""

SUPPORT = 1e-9  # weight in a mixture that counts
_NEGLIGIBLE = 1e-10  # weight in a solver's answer that is none

_ALLOWED = (
    "'mean', 'worst', ('cvar', a) with a level a above 0 and at most 1, or ('tv', r) with a "
    "distance r from 0 to 2"
)


@dataclass(frozen=True)
class Ambiguity:
    """A set Q of priors.

    Parameters
    ----------
    name : {"mean", "worst", "cvar", "tv"}
        The prior p alone; all priors; q <= p / a, the mean over the worst fraction a of cases; or
        sum_k abs(q_k - p_k) <= r.
    parameter : float
        a or r; 0 for the others.

    Raises
    ------
    PlanningError
        In `of`: no such set.
    """

    name: Name
    parameter: float = 0.0

    @classmethod
    def of(cls, value: AmbiguityLike | Ambiguity) -> Ambiguity:
        """The set of a value that `plan` takes."""
        if isinstance(value, Ambiguity):
            return value
        if value in ("mean", "worst"):
            return cls(value)
        if isinstance(value, tuple) and len(value) == 2 and value[0] in ("cvar", "tv"):
            name, parameter = value
            number = isinstance(parameter, int | float) and not isinstance(parameter, bool)
            low, high = (1e-9, 1.0) if name == "cvar" else (0.0, 2.0)
            if number and low <= parameter <= high:
                return cls(name, float(parameter))
        raise PlanningError(
            f"ambiguity = {shown(value)}; allowed: {_ALLOWED}", ambiguity=value, allowed=_ALLOWED
        )

    def __str__(self) -> str:
        return self.name if self.name in ("mean", "worst") else f"{self.name} {self.parameter:g}"

    def worst_prior(self, values: FloatArray, prior: FloatArray) -> FloatArray:
        """The prior (K,) in Q with the least mean of values (K,), of ties the first."""
        order = np.argsort(values, kind="stable")
        worst = np.zeros_like(prior)
        if self.name == "mean":
            worst = prior.copy()
        elif self.name == "worst":
            worst[order[0]] = 1.0
        elif self.name == "cvar":  # as much as is allowed on the least values
            limits = prior[order] / self.parameter
            before = np.concatenate([[0.0], np.cumsum(limits)[:-1]])
            worst[order] = np.clip(1.0 - before, 0.0, limits)
        else:  # half the distance moves from the largest values to the least one
            taken = np.concatenate([[0.0], np.cumsum(prior[order[::-1]])])
            moved = np.clip(self.parameter / 2 - taken[:-1], 0.0, prior[order[::-1]])
            worst[order[::-1]] = prior[order[::-1]] - moved
            worst[order[0]] += moved.sum()
        return worst

    def least(self, values: FloatArray, prior: FloatArray) -> float:
        """Least mean of values (K,) over Q."""
        return float(self.worst_prior(values, prior) @ values)

    def contains(self, weights: FloatArray, prior: FloatArray) -> bool:
        """Return True if weights (K,) are a prior in Q, but for the rounding of their sum."""
        if weights.min() < 0 or abs(weights.sum() - 1.0) > 1e-14 * len(weights):
            return False
        if self.name == "worst":
            return True
        if self.name == "cvar":
            return bool((weights <= prior / self.parameter).all())
        return float(np.abs(weights - prior).sum()) <= (self.parameter if self.name == "tv" else 0)

    def inside(self, weights: FloatArray, prior: FloatArray) -> FloatArray:
        """The nearest prior in Q on the way from weights (K,), a solver's answer, to `prior`."""
        weights = np.where(weights > _NEGLIGIBLE, weights, 0.0)
        weights /= weights.sum()
        for share in (0.0, *10.0 ** np.arange(-14, 0)):
            mixed = (1 - share) * weights + share * prior
            mixed /= mixed.sum()
            if self.contains(mixed, prior):
                return np.asarray(mixed)
        return prior

    def game(self, survivals: FloatArray, prior: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Best mixture (P,) of paths with survivals (P, K), and the worst prior (K,) for it.

        Of risks, with their negative values. The program minimises t over q in Q with
        t >= sum_k q_k s_k(w) for all w: the multipliers of these rows are the mixture.
        """
        from scipy.optimize import linprog
        from scipy.sparse import bmat, csr_matrix

        paths, cases = survivals.shape
        largest = float(np.abs(survivals).max()) or 1.0
        rows, limits = self._rows(prior)
        extra = rows.shape[1] - cases if rows is not None else 0
        payoffs = csr_matrix(
            np.hstack([survivals / largest, np.zeros((paths, extra)), -np.ones((paths, 1))])
        )
        parts: list[Any] = [[payoffs]]
        if rows is not None:
            parts.append([bmat([[rows, csr_matrix((rows.shape[0], 1))]])])
        answer = linprog(
            np.append(np.zeros(cases + extra), 1.0),
            A_ub=bmat(parts).tocsr(),
            b_ub=np.append(np.zeros(paths), limits),
            A_eq=csr_matrix(np.append(np.append(np.ones(cases), np.zeros(extra)), 0.0)[None]),
            b_eq=[1.0],
            bounds=[(0, None)] * (cases + extra) + [(None, None)],
            method="highs",
        )
        if answer.status != 0:
            raise PlanningError(f"no mixture found: {answer.message}", ambiguity=str(self))
        weights = np.maximum(-answer.ineqlin.marginals[:paths], 0.0)
        return weights / weights.sum(), self.inside(answer.x[:cases], prior)

    def _rows(self, prior: FloatArray) -> tuple[Any, FloatArray]:
        """Rows A and limits b with A (q, u) <= b, u further variables; none for all priors."""
        from scipy.sparse import bmat, csr_matrix, eye  # slow to import

        cases = len(prior)
        unit = eye(cases)
        if self.name == "worst":
            return None, np.empty(0)
        if self.name == "tv":  # u_k >= abs(q_k - p_k)
            total = csr_matrix(np.append(np.zeros(cases), np.ones(cases))[None])
            rows = bmat([[unit, -unit], [-unit, -unit]])
            return bmat([[rows], [total]]), np.concatenate([prior, -prior, [self.parameter]])
        return unit, prior / (self.parameter if self.name == "cvar" else 1.0)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Mixture:
    """A distribution over P paths or plans for a hazard that is not known, and what it is worth.

    Several mixtures may have the same value, up to the gap: `weights` and `worst_prior` are those
    of one of them.

    Parameters
    ----------
    weights : (P,)
        Probability of each path or plan, by which one is drawn before the start.
    survivals : (P, K)
        Survival, or success, of every path or plan in every case.
    prior : (K,)
        Weights of the cases.
    ambiguity : Ambiguity
        The set Q of priors that are possible.
    value : Interval
        Least mean survival, or success, over Q: of this mixture below, and a proven bound of all
        mixtures above, 1 if there is none.
    worst_prior : (K,)
        The prior in Q against which no known path or plan is better than this mixture.
    pure_value : float
        Least mean over Q of the best single path or plan that is known.
    known : (K,)
        Survival, or success, of the best known path or plan of every case.
    note : str
        How the bound is proven, or why there is none.
    """

    weights: FloatArray
    survivals: FloatArray
    prior: FloatArray
    ambiguity: Ambiguity
    value: Interval
    worst_prior: FloatArray
    pure_value: float
    known: FloatArray
    note: str = ""

    _unit: ClassVar[str] = "path"

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", Interval(*self.value))  # read back, it is a tuple

    @property
    def measure(self) -> str:
        """What is valued: survival, success or risk."""
        return "survival"

    @property
    def routes(self) -> list[FloatArray]:
        """Positions (T+1, m, 2) of the agent, or of m members, in each path or plan."""
        raise NotImplementedError

    @property
    def survival(self) -> FloatArray:
        """Survival, or success, (K,) of the mixture in every case."""
        return np.asarray(self.weights @ self.survivals)

    @property
    def gap(self) -> float:
        """(high - low) / high of the value."""
        return self.value.width / self.value.high if self.value.high > 0 else 0.0

    @property
    def known_value(self) -> float:
        """Least mean over Q of who knows the case, by the paths or plans of `known`."""
        return self.ambiguity.least(self.known, self.prior)

    def as_dict(self) -> dict[str, Any]:
        """Values by name, for a JSON file."""
        names = "gap", "pure_value", "known_value", "prior", "worst_prior", "survival", "weights"
        values = {name: getattr(self, name) for name in (*names, "note")}
        values |= {"ambiguity": str(self.ambiguity), "value": self.value._asdict()}
        return values | {"paths": self.routes}

    def __repr__(self) -> str:
        low, high = self.value
        number = counted(len(self.weights), self._unit)
        value = f"value={low:.4f} to {rounded_up(high):.4f}"
        return f"{type(self).__name__}({self.ambiguity}, {number}, {value})"

    def _chosen(self, verb: str) -> str:
        """Weights and last steps of the paths or plans, as text."""
        chosen = zip(self.weights, self.routes, strict=True)
        return ", ".join(f"{weight:.3f} {verb} at step {len(path) - 1}" for weight, path in chosen)

    def _text(self, what: str, chosen: str) -> str:
        """Description of a mixture of `what`, with a text of weights."""
        low, high = self.value
        bound = f"no mixture can exceed {rounded_up(high):.4f}" if high < 1 else "not certified"
        cases = ", ".join(f"{s:.4f}" for s in self.survival)
        priors = ", ".join(f"{q:.3f}" for q in self.worst_prior)
        single = what.split(" ", 1)[1].removesuffix("s")
        return (
            f"mixture of {what} for {self.ambiguity}: {self.measure} {low:.4f} ({bound})\n"
            f"best single {single} found {self.pure_value:.4f}, with the case known "
            f"{self.known_value:.4f}\n"
            f"weights: {chosen}\n{self.measure} by case: {cases}; worst prior: {priors}"
            + (f"\n{self.note}" if self.note else "")
        )


def of_game(
    ambiguity: Ambiguity, table: FloatArray, prior: FloatArray
) -> tuple[list[int], dict[str, Any]]:
    """The best mixture of a table (R, K), as rows of it and the fields of a `Mixture` but `known`.

    The value is not bounded above.
    """
    weights, worst = ambiguity.game(table, prior)
    rows = [int(row) for row in np.argsort(-weights, kind="stable") if weights[row] > SUPPORT]
    kept = weights[rows] / weights[rows].sum()
    return rows, {
        "weights": kept,
        "survivals": table[rows],
        "prior": prior,
        "ambiguity": ambiguity,
        "value": Interval(ambiguity.least(kept @ table[rows], prior), 1.0),
        "worst_prior": worst,
        "pure_value": max(ambiguity.least(row, prior) for row in table),
    }

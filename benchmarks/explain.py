"""Explanations of programs with a planted contradiction: what is named, and how long it takes.

Run in a checkout, with the installed package::

    OMP_NUM_THREADS=1 python benchmarks/explain.py               # 100 programs, two minutes
    OMP_NUM_THREADS=1 python benchmarks/explain.py --count 20    # fewer

Every program has 10 to 100 linear and nonlinear rows, equalities among them, that a known point
meets, and a contradiction of 2 to 5 of its rows, or of rows and a bound. The set that is
named is verified once more by its witnesses and by Ipopt: see `verified`. As many feasible
programs have the same rows without the contradiction. Times do not include the first program, in
which kernels are compiled or loaded.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import NamedTuple

import casadi as ca
import numpy as np
from _timing import print_table

import casswarm as csw
from casswarm.solvers import Ipopt


class Planted(NamedTuple):
    """A program as a dictionary with arguments, and the rows of its contradiction."""

    nlp: dict[str, ca.SX]
    arguments: dict[str, np.ndarray]
    rows: frozenset[int]
    variables: frozenset[str] = frozenset()

    def explained(self) -> csw.Explanation:
        """Explanation of the program."""
        return csw.explain(self.nlp, **self.arguments)


def planted(seed: int, contradictory: bool = True, rows: int | None = None) -> Planted:
    """A random program of a seed."""
    rng = np.random.default_rng(seed)
    ng = int(rng.integers(10, 101)) if rows is None else rows
    nx = max(4, ng // 2)
    x, point = ca.SX.sym("x", nx), rng.uniform(-2.0, 2.0, nx)
    g, low, high = [], np.full(ng, -np.inf), np.full(ng, np.inf)
    for i in range(ng):
        some = [int(j) for j in rng.choice(nx, 3, replace=False)]
        a, kind = rng.normal(size=3), rng.integers(4)
        terms = [x[j] for j in some]
        if kind == 1:
            terms = [x[j] ** 2 for j in some]
        elif kind == 2:
            terms = [ca.exp(0.3 * x[j]) for j in some]
        elif kind == 3:
            terms = [x[some[0]] * x[some[1]], ca.sin(x[some[1]]), x[some[2]]]
        g.append(sum(float(c) * t for c, t in zip(a, terms, strict=True)))
        value = float(ca.Function("g", [x], [g[-1]])(point))
        if i % 10 == 9:
            low[i] = high[i] = value
        elif rng.random() < 0.5:
            low[i] = value - rng.uniform(0.5, 2.0)
        else:
            high[i] = value + rng.uniform(0.5, 2.0)
    lbx, ubx = point - rng.uniform(1.0, 5.0, nx), point + rng.uniform(1.0, 5.0, nx)
    chosen: list[int] = []
    variables: list[str] = []
    if contradictory:
        k, form = int(rng.integers(2, 6)), int(rng.integers(4))
        chosen = sorted(int(i) for i in rng.choice(ng, k, replace=False))
        first = chosen[0]
        some = [int(j) for j in rng.choice(nx, k, replace=k > nx)]
        for i in chosen:
            low[i], high[i] = -np.inf, np.inf
        own, gap = [x[j] for j in some], rng.uniform(0.2, 2.0)
        # x_1 + ... + x_{k-1} is at least its value at the point, and each at most less than it
        weights = rng.uniform(0.5, 2.0, k - 1)
        total = sum(float(w) * t for w, t in zip(weights, own[:-1], strict=True))
        at = float(weights @ point[some[:-1]])
        if form == 1:  # a sphere that does not reach the half-spaces
            total = -sum((t - point[j]) ** 2 for t, j in zip(own[:-1], some[:-1], strict=True))
            at = 0.0
            weights = np.zeros(k - 1)
        g[first], low[first] = total, at
        if form == 2:
            high[first] = at  # an equality
        for i, j, w in zip(chosen[1:], some[:-1], weights, strict=True):
            if form == 1:
                g[i], low[i] = x[j], point[j] + gap
                ubx[j] = max(ubx[j], point[j] + 2 * gap)
            elif form == 3:
                g[i], high[i] = ca.exp(x[j]), float(np.exp(point[j] - gap / w))
            else:
                g[i], high[i] = x[j], point[j] - gap / w
            lbx[j] = min(lbx[j], point[j] - 2 * gap / max(w, 0.5))
        if form == 0 and k > 2:  # a bound instead of the last row
            j = some[-2]
            low[chosen[-1]], high[chosen[-1]] = -np.inf, np.inf
            ubx[j] = point[j] - gap / weights[-1]
            variables = [f"x[{j}]"]
            chosen = chosen[:-1]
    arguments = {"x0": rng.uniform(lbx, ubx), "lbx": lbx, "ubx": ubx, "lbg": low, "ubg": high}
    return Planted(
        {"x": x, "g": ca.vertcat(*g)}, arguments, frozenset(chosen), frozenset(variables)
    )


def verified(program: Planted, found: csw.Explanation) -> bool:
    """Whether Ipopt finds no point that meets all that is named, and witnesses meet the rest."""
    a, ng = program.arguments, program.nlp["g"].numel()
    g = ca.Function("g", [program.nlp["x"]], [program.nlp["g"]])
    variables = [int(name[2:-1]) for name in found.variables]
    keep = [("g", i) for i in found.row_indices] + [("x", j) for j in variables]
    for left, x in enumerate(found.witnesses):
        values = {"g": np.asarray(g(x)).ravel(), "x": x}
        for other, (part, i) in enumerate(keep):
            excess = max(a[f"lb{part}"][i] - values[part][i], values[part][i] - a[f"ub{part}"][i])
            if other != left and excess > 1e-5:
                return False
    low, high = np.full(ng, -np.inf), np.full(ng, np.inf)
    lbx, ubx = np.full(len(a["lbx"]), -np.inf), np.full(len(a["lbx"]), np.inf)
    for part, i in keep:
        bounds = (low, high) if part == "g" else (lbx, ubx)
        bounds[0][i], bounds[1][i] = a[f"lb{part}"][i], a[f"ub{part}"][i]
    problem = csw.Problem.from_casadi(program.nlp, x0=a["x0"], lbx=lbx, ubx=ubx, lbg=low, ubg=high)
    return not Ipopt(time_limit=5.0).solve(problem.nlp, problem.starts["given"])[0].status.success


def main() -> None:
    """Print the counts and times."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=100)
    count = parser.parse_args().count
    planted(0).explained()
    same, minimal, wrong, missed, proven, seconds = 0, 0, 0, 0, 0, []
    for seed in range(1, count + 1):
        program = planted(seed)
        found, took = explained(program)
        seconds.append(took)
        if found.feasible is not False:
            missed += 1
            print(f"seed {seed}: not explained; planted {sorted(program.rows)}", file=sys.stderr)
            continue
        proven += found.proven
        if not verified(program, found):
            wrong += 1
            print(f"seed {seed}: wrong set {found}", file=sys.stderr)
        elif set(found.row_indices) == program.rows and set(found.variables) == program.variables:
            same += 1
        else:
            minimal += 1
    points, times = 0, []
    for seed in range(1, count + 1):
        found, took = explained(planted(seed, contradictory=False))
        times.append(took)
        points += found.feasible is True and found.violation <= 1e-6
    answers = (
        f"{same} planted sets, {minimal} other minimal ones, {wrong} wrong, "
        f"{missed} not explained; {proven} proven"
    )
    tenth = range(1, 1 + max(1, count // 10))
    large = [explained(planted(seed, rows=100))[1] for seed in tenth]
    rows = (
        (f"{count} infeasible", answers, seconds),
        (f"{count} feasible", f"a point of {points}", times),
        (f"{len(large)} infeasible, 100 rows", "", large),
    )
    print_table(
        ("programs", "answers", "CPU seconds, median", "largest"),
        ((name, text, f"{np.median(t):.2f}", f"{max(t):.2f}") for name, text, t in rows),
    )


def explained(program: Planted) -> tuple[csw.Explanation, float]:
    """An explanation, and its CPU seconds."""
    started = time.process_time()
    found = program.explained()
    return found, time.process_time() - started


if __name__ == "__main__":
    main()

"""The exact second derivatives of the joint plan's Lagrangian, from those of single steps.

The recursion of `casswarm.problems.joint` is linear in its values: with S_k = S(X(k)) the matrix of
a step over the 2^n sets, F_{k-1} = S_k b_k and b_k = c_k + g_k F_k. With the masses that go
forwards, a_0 = e(everybody) and a_k = g_k (S_k' a_{k-1}), the failure F = F_0(everybody) has

    dF / dX(k)          = d/dX (a_{k-1}' S(X) b_k)
    d2F / dX(k)2        = d2/dX2 (a_{k-1}' S(X) b_k)
    d2F / dX(j) dX(k)   = d/dX (a_{j-1}' S(X) D),  j < k,  a column of D for each entry of X(k):
                          D = g_j S_{j+1} g_{j+1} ... S_{k-1} g_{k-1} d/dX (S(X) b_k).

Everything but D comes from functions of one step, whose derivatives are small; all D of a step are
one matrix, which goes back by one product with S_j. That is about N^2 n 4^n operations, where
automatic differentiation of the whole needs a gradient for each of the 2 n N velocities: thirty
times as long for five members and thirty steps (``python benchmarks/joint.py hessian``).
"""

from __future__ import annotations

import casadi as ca

from ..optimization.problem import Nlp
from ..typing import Expr

MAX_ITERATIONS = 6
"""Members up to which these derivatives are worth their time."""


def lagrangian_hessian(
    nlp: Nlp,
    step: Expr,
    places: Expr,
    values: Expr,
    odds: Expr,
) -> Expr | None:
    """CasADi Function (x, p, lam_f, lam_g) to the upper triangle that ``hess_lag`` wants.

    Parameters
    ----------
    nlp : Nlp
        With the parameters goes_on, costs, last and clock.
    step : Function
        (b, x, clock) to S(x) b.
    places : MX (2 n, N)
        X(1), ..., X(N), linear in the variables.
    values : MX (2^n, N)
        F_0, ..., F_{N-1}.
    odds : Function
        F to the objective.

    Returns
    -------
    Function or None
        None for rates that do not expand to scalar operations, such as a user's callback.
    """
    try:
        parts = _parts(step.expand(), values.shape[0], places.shape[0])
    except RuntimeError:
        return None
    p = nlp.parameters
    after = p["costs"] + p["goes_on"] * ca.horzcat(values[:, 1:], p["last"])
    gradient, hessian = _of_places(parts, after, p["goes_on"], places, p["clock"])
    moves = ca.jacobian(ca.vec(places), nlp.x)
    gradient = ca.mtimes(moves.T, gradient)
    hessian = ca.mtimes(moves.T, ca.mtimes(hessian, moves))
    failure = ca.MX.sym("F")
    slope = ca.gradient(odds(failure), failure)
    bend = ca.gradient(slope, failure)
    at = ca.Function("odds", [failure], [slope, bend])(values[values.shape[0] - 1, 0])
    weight, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.g.shape[0])
    limits = ca.hessian(ca.dot(multipliers, nlp.g), nlp.x)[0]
    whole = weight * (at[0] * hessian + at[1] * ca.mtimes(gradient, gradient.T)) + limits
    given = [nlp.x, nlp.p, weight, multipliers]
    return ca.Function("nlp_hess_l", given, [ca.triu(ca.densify(whole))])


def _of_places(
    parts: Expr,
    after: Expr,
    goes_on: Expr,
    places: Expr,
    clock: Expr,
) -> tuple[Expr, Expr]:
    """Gradient (2 n N,) and Hessian of F in X(1), ..., X(N); `after` are b_1, ..., b_N."""
    width, steps = places.shape
    masses = ca.DM.zeros(after.shape[0], 1)
    masses[-1] = 1.0
    gradient, found = [], []
    for k in range(steps):
        first, *second = parts(masses, after[:, k], places[:, k], clock)
        gradient.append(first)
        found.append(second)
        masses = goes_on[:, k] * ca.mtimes(second[-1].T, masses)
    rows, later = [found[-1][0]], ca.MX(after.shape[0], 0)
    for j in reversed(range(steps - 1)):
        _, fall, _, matrix = found[j + 1]
        later = ca.horzcat(fall, ca.mtimes(matrix, later))
        later = later * ca.repmat(goes_on[:, j], 1, later.shape[1])
        rows.append(ca.horzcat(found[j][0], ca.mtimes(found[j][2], later)))
    rows = [ca.horzcat(ca.MX(width, width * k), row) for k, row in enumerate(reversed(rows))]
    return ca.vertcat(*gradient), ca.triu2symm(ca.triu(ca.densify(ca.vertcat(*rows))))


def _parts(step: Expr, sets: int, width: int) -> Expr:
    """(a, b, x, clock) to d(a'Sb)/dx, d2(a'Sb)/dx2, d(Sb)/dx, the transpose of d(S'a)/dx, and S."""
    a, b = ca.SX.sym("a", sets), ca.SX.sym("b", sets)
    x, clock = ca.SX.sym("x", width), ca.SX.sym("clock")
    moved = step(b, x, clock)
    within, gradient = ca.hessian(ca.dot(a, moved), x)
    matrix = ca.jacobian(moved, b)
    rises = ca.jacobian(ca.mtimes(matrix.T, a), x).T
    found = [gradient, within, ca.jacobian(moved, x), rises, matrix]
    return ca.Function("parts", [a, b, x, clock], [ca.densify(part) for part in found])

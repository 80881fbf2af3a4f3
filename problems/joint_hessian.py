"""The exact second derivatives of the joint plan's Lagrangian, from those of single steps.

The recursion of `casswarm.problems.joint` is linear in its values: with S_k = S(X(k)) the matrix of
a step over the 2^n sets, F_{k-1} = S_k b_k and b_k = c_k + g_k F_k. With the forward masses
a_0 = e(all members) and a_k = g_k (S_k' a_{k-1}), the failure F = F_0(all members) has

    dF / dX(k)          = d/dX (a_{k-1}' S(X) b_k)
    d2F / dX(k)2        = d2/dX2 (a_{k-1}' S(X) b_k)
    d2F / dX(j) dX(k)   = d/dX (a_{j-1}' S(X) D),  j < k,  a column of D for each entry of X(k):
                          D = g_j S_{j+1} g_{j+1} ... S_{k-1} g_{k-1} d/dX (S(X) b_k).

All terms but D are derivatives of functions of one step, which are small; all D of a step form one
matrix, which is propagated back by one product with S_j. This takes about N^2 n 4^n operations; see
``docs/joint.md`` for times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from ..nlp.program import Nlp
from ..typing import Expr

MAX_MEMBERS = 6
"""Maximum number of members for which these derivatives pay off."""


def lagrangian_hessian(
    nlp: Nlp,
    cases: Sequence[tuple[Sequence[Expr], Expr]],
    points: Expr,
    prior: Expr,
    odds: Callable[[Expr], Expr],
) -> Expr | None:
    """CasADi Function (x, p, lam_f, lam_g) of the upper triangle that ``hess_lag`` expects.

    The program has parameters continues, costs, last_cost and clock. Each case has its steps,
    Functions (F, x, g, c, clock) of S(x) (c + g F), one for each step or one for all, and values
    (2^n, N) F_0, ..., F_{N-1}. `points` (2 n, N) are X(1), ..., X(N), linear in the variables, and
    `odds` takes the mean of F over the cases by their `prior` (K,) to the objective. None for steps
    that are not of scalar operations, as with a user's callback.
    """
    if not all(steps[0].is_a("SXFunction") for steps, _ in cases):
        return None
    failures = ca.vertcat(*(values[-1, 0] for _, values in cases))
    each = [_of_failure(nlp, steps, values, points) for steps, values in cases]
    gradient = ca.mtimes(ca.horzcat(*(first for first, _ in each)), prior)
    hessian = sum(ca.MX(prior)[k] * second for k, (_, second) in enumerate(each))
    jacobian = ca.jacobian(ca.vec(points), nlp.x)
    gradient = ca.mtimes(jacobian.T, gradient)
    hessian = ca.mtimes(jacobian.T, ca.mtimes(hessian, jacobian))
    failure = ca.MX.sym("F")
    first = ca.gradient(odds(failure), failure)
    second = ca.gradient(first, failure)
    at = ca.Function("odds", [failure], [first, second])(ca.dot(prior, failures))
    weight, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.g.shape[0])
    constraints = ca.hessian(ca.dot(multipliers, nlp.g), nlp.x)[0]
    objective = at[0] * hessian + at[1] * ca.mtimes(gradient, gradient.T)
    lagrangian = weight * objective + constraints
    arguments = [nlp.x, nlp.p, weight, multipliers]
    return ca.Function("nlp_hess_l", arguments, [ca.triu(ca.densify(lagrangian))])


def _of_failure(nlp: Nlp, steps: Sequence[Expr], values: Expr, points: Expr) -> tuple[Expr, Expr]:
    """Gradient and Hessian of the failure of a case in X(1), ..., X(N)."""
    derivatives = [_step_derivatives(step, values.shape[0], points.shape[0]) for step in steps]
    p = nlp.parameters
    after = p["costs"] + p["continues"] * ca.horzcat(values[:, 1:], p["last_cost"])
    return _by_points(derivatives, after, p["continues"], points, p["clock"])


def _by_points(
    derivatives: Sequence[Expr], after: Expr, continues: Expr, points: Expr, clock: Expr
) -> tuple[Expr, Expr]:
    """Gradient (2 n N,) and Hessian of F in X(1), ..., X(N); `after` are b_1, ..., b_N."""
    width, steps = points.shape
    masses = ca.DM.zeros(after.shape[0], 1)
    masses[-1] = 1.0
    gradient, blocks = [], []
    for k in range(steps):
        first, *second = derivatives[k % len(derivatives)](masses, after[:, k], points[:, k], clock)
        gradient.append(first)
        blocks.append(second)
        masses = continues[:, k] * ca.mtimes(second[-1].T, masses)
    rows, later = [blocks[-1][0]], ca.MX(after.shape[0], 0)
    for j in reversed(range(steps - 1)):
        _, by_value, _, matrix = blocks[j + 1]
        later = ca.horzcat(by_value, ca.mtimes(matrix, later))
        later = later * ca.repmat(continues[:, j], 1, later.shape[1])
        rows.append(ca.horzcat(blocks[j][0], ca.mtimes(blocks[j][2], later)))
    rows = [ca.horzcat(ca.MX(width, width * k), row) for k, row in enumerate(reversed(rows))]
    return ca.vertcat(*gradient), ca.triu2symm(ca.triu(ca.densify(ca.vertcat(*rows))))


def _step_derivatives(step: Expr, sets: int, width: int) -> Expr:
    """(a, b, x, clock) to d(a'Sb)/dx, d2(a'Sb)/dx2, d(Sb)/dx, the transpose of d(S'a)/dx, and S."""
    a, b = ca.SX.sym("a", sets), ca.SX.sym("b", sets)
    x, clock = ca.SX.sym("x", width), ca.SX.sym("clock")
    product = step(b, x, ca.DM.ones(sets), ca.DM.zeros(sets), clock)
    hessian, gradient = ca.hessian(ca.dot(a, product), x)
    matrix = ca.jacobian(product, b)
    by_masses = ca.jacobian(ca.mtimes(matrix.T, a), x).T
    outputs = [gradient, hessian, ca.jacobian(product, x), by_masses, matrix]
    return ca.Function("derivatives", [a, b, x, clock], [ca.densify(item) for item in outputs])

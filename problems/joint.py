"""The joint plan: trajectories of all members at once, for the success of the swarm itself.

The paper calls this problem too complex to compute, and uses a guide with formations around it.
An open-loop plan X_i(1..T) of all n members, with arrival steps T_i, has an exact success
probability. With d the set of living members, F_t(d) the probability that from step t on no member
arrives, and q_i(t, d) = 1 - exp(-dt lambda_i(X(t), d)),

    F_t(d) = sum over d' of d of  prod_{i in d'} (1 - q_i) prod_{i in d - d'} q_i  f_{t+1}(d'),
             q_i = q_i(t+1, d),
    f_t(d') = 0 if some i in d' has T_i = t, because the run ends there, else F_t(d'),
    F_N(d) = 1.

The sum is contracted member by member (`casswarm.problems.subsets`). In general a run that ends at
step t with d' alive costs c_t(d') in [0, 1]: 0 for ``"success"``; the fraction of members that are
not in the target then for ``"arrivals"``; the fraction of lost members for ``"survivors"``. The
program is

    minimise    log F - log(1 - F),  F = F_0(all members)
    over        V_i(0..T-1)
    subject to  -v_max <= V_i(t) <= v_max                       equation (4)
                ||V_i(t) - V_i(t-1)||^2 <= a_max                 equation (5)
                ||X_i(T_i) - c||^2 <= (radius - margin)^2
                ||X_i(t) - c||^2 >= radius^2, t < T_i            optional
                ||X_i(t) - X_j(t)||^2 >= min_distance^2, t >= 1   optional

with X_i(t+1) = X_i(t) + dt V_i(t) eliminated. Log-odds are well scaled both for F near 0 and for F
near 1. A member that passes through the target before T_i arrives there, which F does not model:
for success and survivors it is then an upper bound of the plan's cost, because an earlier end of a
run never costs more. For arrivals it would: there the members must stay outside until T_i.

**Mean field.** For large swarms, with too many sets, every member i has a probability s_i(t) of
being alive, s_i(0) = 1, and sees the others with these probabilities as weights:

    s_i(t) = s_i(t-1) exp(-dt lambda_i(X(t), s(t-1) with s_i = 1)),    t <= T_i,
    F = prod_i (1 - s_i(T_i)) for success,    1 - sum_i s_i(T_i) / n for the other two.

This treats the members' survival as independent and replaces the density by its mean. It is an
approximation, neither a bound nor exact (except for n = 1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from ..hazard import Hazard
from ..optimization.problem import Nlp
from ..typing import Expr
from .joint_hessian import MAX_MEMBERS, lagrangian_hessian
from .subsets import subsets

OBJECTIVES = ("success", "arrivals", "survivors")

_TINY, _CERTAIN = 1e-30, 1e-13
"""Offsets that keep the log-odds finite at a cost of 0 and of 1."""


@dataclass(frozen=True)
class JointForm:
    """Variant of the joint plan's program.

    Parameters
    ----------
    n, horizon : int
        Number of members, and number of steps N.
    exact : bool
        Whether the objective is that of the recursion over sets, or the mean field's.
    objective : {"success", "arrivals", "survivors"}
    separated : bool
        Whether members keep a minimum distance.
    """

    n: int
    horizon: int
    exact: bool = True
    objective: str = "success"
    separated: bool = False

    @property
    def outside(self) -> bool:
        """Whether members stay outside the target until their arrival step."""
        return self.objective == "arrivals"


@lru_cache(maxsize=64)
def joint_nlp(hazard: Hazard, form: JointForm) -> Nlp:
    """The program above, in steps and in lengths of a step at v_max.

    Blocks have a column per step; those of points hold (x_1, y_1, ..., x_n, y_n).
    """
    n, steps = form.n, form.horizon
    V = ca.MX.sym("velocities", 2 * n, steps)
    start, initial_velocities = (ca.MX.sym(name, 2 * n) for name in ("start", "initial_velocities"))
    center, origin = ca.MX.sym("center", 2), ca.MX.sym("origin", 2)
    length, clock = ca.MX.sym("length"), ca.MX.sym("clock")
    arrivals = ca.MX.sym("arrivals", n, steps)
    X = ca.repmat(start, 1, steps) + ca.mtimes(V, ca.DM.ones(ca.Sparsity.upper(steps)))
    points = ca.repmat(origin, n, steps) + length * X
    values = None
    if form.exact:
        terminal, values = _recursion(hazard, form, points, clock)
        objective = _log_odds()(values[2**n - 1, 0])
    else:
        terminal, objective = {}, _mean_field(hazard, form, points, clock, arrivals)
    to_center = _squares(X - ca.repmat(center, n, steps))
    constraints = {
        "acceleration": _squares(V - ca.horzcat(initial_velocities, V[:, :-1])),
        "arrival": ca.sum2(arrivals * to_center).T,
    }
    if form.outside:
        constraints["outside"] = to_center
    if form.separated and n > 1:
        constraints["separation"] = _squares(ca.mtimes(_differences(n), X))
    program = Nlp(
        name=f"joint[{n}, {steps}, {form.objective}{'' if form.exact else ', mean field'}]",
        variables={"velocities": V},
        parameters={
            **terminal,
            "arrivals": arrivals,
            "start": start,
            "initial_velocities": initial_velocities,
            "center": center,
            "origin": origin,
            "length": length,
            "clock": clock,
        },
        objective=objective,
        constraints=constraints,
    )
    if values is None or n > MAX_MEMBERS:
        return program
    hessian = lagrangian_hessian(program, _matrix(hazard, n), points, values, _log_odds())
    return replace(program, hessian=hessian)


def _log_odds() -> Expr:
    """CasADi Function of a probability to its log-odds."""
    failure = ca.MX.sym("F")
    odds = ca.log(failure + _TINY) - ca.log(1.0 - failure + _CERTAIN)
    return ca.Function("log_odds", [failure], [odds])


def _matrix(hazard: Hazard, n: int) -> Expr:
    """CasADi Function (b, x, clock) of a step as a matrix over the sets, times a column."""
    column, x, clock = ca.MX.sym("b", 2**n), ca.MX.sym("x", 2 * n), ca.MX.sym("clock")
    ones, zeros = ca.DM.ones(2**n), ca.DM.zeros(2**n)
    product = _step(hazard, n)(column, x, ones, zeros, clock)
    return ca.Function("matrix", [column, x, clock], [product])


def _recursion(
    hazard: Hazard, form: JointForm, points: Expr, clock: Expr
) -> tuple[dict[str, Expr], Expr]:
    """Parameters of the ends of runs, and F_0, ..., F_{N-1}, (2^n, N)."""
    count, steps = 2**form.n, form.horizon
    continues = ca.MX.sym("continues", count, steps)
    costs = ca.MX.sym("costs", count, steps)
    last_cost = ca.MX.sym("last_cost", count)
    step = _step(hazard, form.n)
    backwards = step.mapaccum("recursion", steps)
    values = backwards(
        last_cost,
        points[:, ::-1],
        continues[:, ::-1],
        costs[:, ::-1],
        ca.repmat(clock, 1, steps),
    )
    return {"continues": continues, "costs": costs, "last_cost": last_cost}, values[:, ::-1]


def _step(hazard: Hazard, n: int) -> Expr:
    """CasADi Function of a step of the recursion: F_{t+1} and X(t+1) to F_t."""
    pairs = subsets(n)
    count = len(pairs.members)
    value, x = ca.MX.sym("value", count), ca.MX.sym("x", 2 * n)
    continues, cost = ca.MX.sym("continues", count), ca.MX.sym("cost", count)
    clock = ca.MX.sym("clock")
    rates = hazard.expressions(ca.reshape(x, 2, n), ca.DM(pairs.members.astype(float)))
    lost = -ca.expm1(-clock * rates)
    contracted = (cost + continues * value)[pairs.survivors.tolist()].T
    for i, masks in enumerate(pairs.stages):
        outside, dead, alive = ca.horzsplit(contracted, masks.shape[1])
        q = ca.reshape(lost[:, i][masks.ravel(order="F").tolist()], *masks.shape)
        contracted = ca.vertcat(outside, alive + q * (dead - alive))
    return ca.Function("step", [value, x, continues, cost, clock], [contracted])


def _mean_field(hazard: Hazard, form: JointForm, points: Expr, clock: Expr, arrivals: Expr) -> Expr:
    """Log-odds of the mean field's F."""
    n, steps = form.n, form.horizon
    alive, x, under_way = ca.MX.sym("alive", n), ca.MX.sym("x", 2 * n), ca.MX.sym("under_way", n)
    time = ca.MX.sym("clock")
    identity = ca.DM.eye(n)
    field = ca.repmat(alive.T, n, 1) * (1 - identity) + identity
    rates = ca.diag(hazard.expressions(ca.reshape(x, 2, n), field))
    following = alive * ca.exp(-time * under_way * rates)
    step = ca.Function("step", [alive, x, under_way, time], [following])
    # a member is under way until its arrival step: the sum of its indicators from each step on
    remaining = ca.mtimes(arrivals, ca.DM.ones(ca.Sparsity.lower(steps)))
    clocks = ca.repmat(clock, 1, steps)
    survival = step.mapaccum("field", steps)(ca.DM.ones(n), points, remaining, clocks)[:, -1]
    survival = survival * ca.sum2(arrivals)  # members that never arrive do not count
    if form.objective != "success":
        failure = 1.0 - ca.sum1(survival) / n
        return ca.log(failure + _TINY) - ca.log(1.0 - failure + _CERTAIN)
    logarithm = ca.sum1(ca.log1p(-survival + _CERTAIN))
    return logarithm - ca.log(_CERTAIN - ca.expm1(logarithm))


def _squares(vectors: Expr) -> Expr:
    """Squared lengths (m, c) of points in the plane (2 m, c)."""
    pairing = ca.kron(ca.DM.eye(vectors.shape[0] // 2), ca.DM.ones(1, 2))
    return ca.mtimes(pairing, vectors**2)


def _differences(n: int) -> Expr:
    """Matrix (n (n-1), 2 n) from members' positions to the differences of all pairs."""
    first, second = np.triu_indices(n, 1)
    rows = np.zeros((len(first), n))
    rows[np.arange(len(first)), first], rows[np.arange(len(first)), second] = 1.0, -1.0
    return ca.kron(ca.sparsify(ca.DM(rows)), ca.DM.eye(2))

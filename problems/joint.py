"""The joint plan: trajectories of all members at once, for the success of the swarm itself.

An open-loop plan X_i(1..N) of all n members over the N steps until t_f, with arrival steps T_i, has
an exact success probability. With d the set of living members, lambda_i(X, d) the rate of member i
per unit time, F_t(d) the probability that from step t on no member arrives, and
q_i(t, d) = 1 - exp(-dt lambda_i(X(t), d)) the probability of its loss,

    F_t(d) = sum over d' of d of  prod_{i in d'} (1 - q_i) prod_{i in d - d'} q_i  f_{t+1}(d'),
             q_i = q_i(t+1, d),
    f_t(d') = 0 if some i in d' has T_i = t (or as many as ``success.arrivals``), because the run
              ends there, else F_t(d'),
    F_N(d) = 1.

In general a run that ends at step t with d' alive costs c_t(d') in [0, 1]: 0 for ``"success"``; the
fraction of members that are not in the target then for ``"arrivals"``; the fraction of lost members
for ``"survivors"``. The program is

    minimise    log F - log(1 - F),  F = F_0(all members)
    over        V_i(0..N-1), zero from max T_i on if all arrive
    subject to  -v_max <= V_i(t) <= v_max                       equation (4)
                ||V_i(t) - V_i(t-1)||^2 <= a_max                 equation (5)
                ||X_i(T_i) - c||^2 <= (radius - margin)^2
                ||X_i(t) - c||^2 >= radius^2, t < T_i            optional
                ||X_i(t) - X_j(t)||^2 >= min_distance^2, t >= 1   optional

with X_i(t+1) = X_i(t) + dt V_i(t) eliminated; ``docs/joint.md`` gives the reasons.

**Mean field.** For large swarms, with too many sets, every member i has a probability s_i(t) of
being alive, s_i(0) = 1, and sees the others with these probabilities as weights:

    s_i(t) = s_i(t-1) exp(-dt lambda_i(X(t), s(t-1) with s_i = 1)),    t <= T_i,
    F = prod_i (1 - s_i(T_i)) for success,    1 - sum_i s_i(T_i) / n for the other two.

This is an approximation, neither a bound nor exact (except for n = 1).

**Hazards that are not known.** With rates that depend on a case k of prior p_k, F is the mean
sum_k p_k F^k of those of the cases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from .._util.threads import locked_cache
from ..hazard import Hazard
from ..motion.step import Motion
from ..nlp.program import Instances, LagrangianHessian, Nlp
from ..typing import BoolArray, Expr, FloatArray, IntArray
from .guide import tightened
from .joint_hessian import MAX_MEMBERS, lagrangian_hessian
from .member_sets import subsets

if TYPE_CHECKING:
    from ..scenario import Scenario

OBJECTIVES = ("success", "arrivals", "survivors")

TINY, CERTAIN = 1e-30, 1e-13
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
    first : int
        Step at which the plan begins, for rates that depend on time; else 0.
    """

    n: int
    horizon: int
    exact: bool = True
    objective: str = "success"
    separated: bool = False
    first: int = 0

    @property
    def outside(self) -> bool:
        """True if members stay outside the target until their arrival step."""
        return self.objective == "arrivals"


@locked_cache(maxsize=64)
def joint_nlp(hazard: Hazard | tuple[Hazard, ...], form: JointForm, hessian: bool = True) -> Nlp:
    """The program of `casswarm.problems.joint`, in steps and in lengths of a step at v_max.

    Several hazards are those of K cases, and their prior (K,) is a parameter. Blocks have a column
    per step; those of points hold (x_1, y_1, ..., x_n, y_n). `hessian` tells whether to build
    second derivatives in CasADi, which takes a second with a hundred steps; casswarm's own solver
    has others if the rates are made of kernels.
    """
    n, steps = form.n, form.horizon
    hazards = hazard if isinstance(hazard, tuple) else (hazard,)
    sets = 2**n if form.exact else 0  # the mean field has no blocks of sets
    shapes = {
        "continues": (sets, steps),
        "costs": (sets, steps),
        "last_cost": (sets, 1),
        "arrivals": (n, steps),
        "start": (2 * n, 1),
        "initial_velocities": (2 * n, 1),
        "center": (2, 1),
        "origin": (2, 1),
        "length": (1, 1),
        "clock": (1, 1),
        "prior": (len(hazards) if len(hazards) > 1 else 0, 1),
    }
    p = {name: ca.MX.sym(name, *shape) for name, shape in shapes.items() if all(shape)}
    V = ca.MX.sym("velocities", 2 * n, steps)
    X = ca.repmat(p["start"], 1, steps) + ca.mtimes(V, ca.DM.ones(ca.Sparsity.upper(steps)))
    to_center = _squares(X - ca.repmat(p["center"], n, steps))
    constraints = {
        "acceleration": _squares(V - ca.horzcat(p["initial_velocities"], V[:, :-1])),
        "arrival": ca.sum2(p["arrivals"] * to_center).T,
    }
    if form.outside:
        constraints["outside"] = to_center
    if form.separated and n > 1:
        first, second = (np.eye(n)[members] for members in np.triu_indices(n, 1))
        differences = ca.sparsify(ca.DM(np.kron(first - second, np.eye(2))))
        constraints["separation"] = _squares(ca.mtimes(differences, X))
    points = ca.repmat(p["origin"], n, steps) + p["length"] * X
    if form.exact:
        recursions = [_recursion(each, form, p, points) for each in hazards]
        failures = ca.vertcat(*(values[-1, 0] for _, values in recursions))
        prior = p.get("prior", 1.0)
        objective = _log_odds(ca.dot(prior, failures) if len(hazards) > 1 else failures)
    else:
        objective = _mean_field(hazards[0], form, p, points)
    program = Nlp(
        name=f"joint[{n}, {steps}, {form.objective}{'' if form.exact else ', mean field'}]",
        variables={"velocities": V},
        parameters=p,
        objective=objective,
        constraints=constraints,
    )
    if hessian and form.exact and n <= MAX_MEMBERS:
        of_lagrangian = lagrangian_hessian(program, recursions, points, prior, _log_odds)
        if of_lagrangian is not None:
            program = program.with_attachments(LagrangianHessian(of_lagrangian))
    return program


def _recursion(
    hazard: Hazard, form: JointForm, p: Mapping[str, Expr], points: Expr
) -> tuple[list[Expr], Expr]:
    """CasADi Functions of the steps, and F_0, ..., F_{N-1} (2^n, N)."""
    functions = _by_step(_step, hazard, form)
    clocks = ca.repmat(p["clock"], 1, form.horizon)
    reverse = [each[:, ::-1] for each in (points, p["continues"], p["costs"])]
    backwards = _accumulated(functions[::-1], p["last_cost"], *reverse, clocks)
    return functions, backwards[:, ::-1]


def _log_odds(failure: Expr) -> Expr:
    return ca.log(failure + TINY) - ca.log(1.0 - failure + CERTAIN)


def _by_step(make: Callable[[Hazard, int], Expr], hazard: Hazard, form: JointForm) -> list[Expr]:
    """CasADi Functions of the steps of a plan; a single one if all steps are alike."""
    steps = range(form.first + 1, form.first + form.horizon + 1) if hazard.changes else [0]
    return [make(hazard.after(step), form.n) for step in steps]


def _accumulated(functions: Sequence[Expr], first: Expr, *columns: Expr) -> Expr:
    """Values after each step of a recursion, in columns, from the first value on."""
    if len(functions) == 1:
        return functions[0].mapaccum("recursion", columns[0].shape[1])(first, *columns)
    values = [first]
    for step, function in enumerate(functions):
        values.append(function(values[-1], *(column[:, step] for column in columns)))
    return ca.horzcat(*values[1:])


@locked_cache(maxsize=512)
def _step(hazard: Hazard, n: int) -> Expr:
    """CasADi Function of a step of the recursion: F_{t+1} and X(t+1) to F_t.

    Of scalar operations, which is faster, for few members whose rates have such.
    """
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
    function = ca.Function("step", [value, x, continues, cost, clock], [contracted])
    try:
        return function.expand() if n <= MAX_MEMBERS else function
    except RuntimeError:
        return function


def _mean_field(hazard: Hazard, form: JointForm, p: Mapping[str, Expr], points: Expr) -> Expr:
    """Log-odds of the mean field's F."""
    n, steps = form.n, form.horizon
    functions = _by_step(_mean_step, hazard, form)
    # a member is under way until its arrival step: the sum of its indicators from each step on
    remaining = ca.mtimes(p["arrivals"], ca.DM.ones(ca.Sparsity.lower(steps)))
    clocks = ca.repmat(p["clock"], 1, steps)
    survival = _accumulated(functions, ca.DM.ones(n), points, remaining, clocks)[:, -1]
    survival = survival * ca.sum2(p["arrivals"])  # members that never arrive do not count
    if form.objective != "success":
        return _log_odds(1.0 - ca.sum1(survival) / n)
    logarithm = ca.sum1(ca.log1p(-survival + CERTAIN))
    return logarithm - ca.log(CERTAIN - ca.expm1(logarithm))


def _mean_step(hazard: Hazard, n: int) -> Expr:
    """CasADi Function of a step of the mean field."""
    alive, x, under_way = ca.MX.sym("alive", n), ca.MX.sym("x", 2 * n), ca.MX.sym("under_way", n)
    clock, identity = ca.MX.sym("clock"), ca.DM.eye(n)
    field = ca.repmat(alive.T, n, 1) * (1 - identity) + identity
    rates = ca.diag(hazard.expressions(ca.reshape(x, 2, n), field))
    following = alive * ca.exp(-clock * under_way * rates)
    return ca.Function("step", [alive, x, under_way, clock], [following])


def _squares(vectors: Expr) -> Expr:
    """Squared lengths (m, c) of points in the plane (2 m, c)."""
    pairing = ca.kron(ca.DM.eye(vectors.shape[0] // 2), ca.DM.ones(1, 2))
    return ca.mtimes(pairing, vectors**2)


MARGIN = 1e-5
"""Margin of arrival relative to the target's radius, above what a solver's tolerance leaves."""


@dataclass(frozen=True, eq=False)
class JointTask:
    """Initial state, target and limits of the members of a swarm.

    Parameters
    ----------
    start, initial_velocities : (n, 2)
        X(0) and V(-1).
    center : (2,)
    radius, margin : float
        Of the target; members arrive at most ``radius - margin`` from its centre.
    motion : Motion
        Limits of the members' velocities, and dt.
    steps : int
        Number of steps until t_f.
    min_distance : float
        Between members at every step after the first; 0 for none.
    needed : int
        Number of living members in the target that ends a run.
    counting : (n,) bool, optional
        Members whose arrival counts; all by default.
    known : int
        Number of first steps whose velocities are those of the guess.
    prior : (K,), optional
        Of the cases of a hazard that is not known.
    """

    start: FloatArray
    initial_velocities: FloatArray
    center: FloatArray
    radius: float
    margin: float
    motion: Motion
    steps: int
    min_distance: float = 0.0
    needed: int = 1
    counting: BoolArray | None = None
    known: int = 0
    prior: FloatArray | None = None

    @classmethod
    def from_scenario(
        cls, scenario: Scenario, initial_velocities: FloatArray, min_distance: float = 0.0
    ) -> JointTask:
        """Task of a scenario's members with V(-1) = `initial_velocities` (n, 2)."""
        weights = [case.weight for case in scenario.cases]
        return cls(
            start=scenario.positions,
            initial_velocities=initial_velocities,
            center=np.asarray(scenario.target.center, float),
            radius=scenario.target.radius,
            margin=MARGIN * scenario.target.radius,
            motion=Motion.from_scenario(scenario),
            steps=scenario.n_steps,
            min_distance=min_distance,
            needed=scenario.success.arrivals,
            counting=None if scenario.swarm.kind is None else scenario.swarm.counting,
            prior=None if len(weights) == 1 else np.array(weights),
        )


def joint_instances(
    nlp: Nlp,
    form: JointForm,
    task: JointTask,
    arrivals: Sequence[IntArray],
    velocities: Sequence[FloatArray],
) -> Instances:
    """Instances with arrival steps (n,) each, 0 for none, and guesses of (T, n, 2) velocities.

    Members of a swarm that has arrived completely by step T stop there.
    """
    parts = [
        _instance(nlp, form, task, steps, guess)
        for steps, guess in zip(arrivals, velocities, strict=True)
    ]

    def together(name: str) -> FloatArray:
        return np.concatenate([getattr(part, name) for part in parts])

    x0, p, lbx, ubx, lbg, ubg = map(together, ("x0", "p", "lbx", "ubx", "lbg", "ubg"))
    return Instances(x0, p, lbx, ubx, lbg, ubg)


def _instance(
    nlp: Nlp, form: JointForm, task: JointTask, arrivals: IntArray, velocities: FloatArray
) -> Instances:
    n, steps, motion = form.n, form.horizon, task.motion
    length, unit = motion.dt * motion.v_max, motion.v_max
    speeds, changes = motion.bounds[:, :1] / unit, motion.bounds[:, 1] / unit**2
    arriving = np.arange(1, steps + 1)[:, None] == arrivals  # (N, n)
    last = int(arrivals.max()) if arrivals.all() else task.steps
    moving = np.arange(steps)[:, None] < last  # (N, 1)
    free = moving & (np.arange(steps)[:, None] >= task.known)
    guess = np.zeros((steps, n, 2))
    guessed = min(len(velocities), last)
    guess[:guessed] = np.clip(velocities[:guessed] / unit, -speeds, speeds)
    fastest = np.where(free, np.broadcast_to(speeds, (n, 2)).ravel(), 0.0)
    given = np.where(free, 0.0, guess.reshape(steps, 2 * n))
    origin = task.start.mean(axis=0)
    terminal: dict[str, ArrayLike] = {}
    if form.exact:
        counting = arriving if task.counting is None else arriving & task.counting
        costs, ended, last_cost = terminal_costs(form.objective, n, counting, task.needed)
        terminal = {"continues": ~ended, "costs": costs, "last_cost": last_cost[None]}
    if task.prior is not None:
        terminal["prior"] = task.prior[None]
    change = np.where(free, changes, np.inf)
    early = (arrivals > 0) & (arrivals <= task.known)
    reach = np.where(early, np.inf, task.radius - task.margin)[:, None]
    lower: dict[str, ArrayLike] = {"acceleration": -np.inf, "arrival": -np.inf}
    upper: dict[str, ArrayLike] = {
        "acceleration": tightened(change),
        "arrival": tightened((reach / length) ** 2),
    }
    if form.outside:
        under_way = arriving[::-1].cumsum(axis=0)[::-1] > arriving
        outside = ((task.radius + task.margin) / length) ** 2
        lower["outside"], upper["outside"] = np.where(under_way, outside, -np.inf), np.inf
    if "separation" in nlp.constraints:
        least = (task.min_distance / length) ** 2
        lower["separation"], upper["separation"] = np.where(free, least, -np.inf), np.inf
    return Instances(
        x0=nlp.pack_variables(velocities=guess.reshape(steps, 2 * n)),
        p=nlp.pack_parameters(
            **terminal,
            arrivals=arriving,
            start=((task.start - origin) / length).reshape(1, -1),
            initial_velocities=(task.initial_velocities / unit).reshape(1, -1),
            center=((task.center - origin) / length)[None],
            origin=origin[None],
            length=length,
            clock=motion.dt,
        ),
        lbx=nlp.pack_variables(velocities=given - fastest),
        ubx=nlp.pack_variables(velocities=given + fastest),
        lbg=nlp.pack_constraints(**lower),
        ubg=nlp.pack_constraints(**upper),
    )


def terminal_costs(
    objective: str, n: int, inside: BoolArray, needed: int = 1
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Costs of runs by the step at which they end and the set d that is alive then.

    `inside` (N, n) tells whether each member that counts is in the target at steps 1..N, and
    `needed` how many living ones end a run. Costs (N, 2^n) are of runs that end so at a step, 0
    where they do not; then whether they do (N, 2^n); and costs (2^n,) of runs that end after step N
    without success.
    """
    members = subsets(n).members
    arriving = inside.astype(float) @ members.T
    lost = 1.0 - members.mean(axis=1)
    costs, last = np.zeros_like(arriving), np.ones(2**n)
    if objective == "arrivals":
        costs = 1.0 - arriving / n
    elif objective == "survivors":
        costs, last = np.broadcast_to(lost, arriving.shape), lost
    ended = arriving >= needed
    return np.where(ended, costs, 0.0), ended, last

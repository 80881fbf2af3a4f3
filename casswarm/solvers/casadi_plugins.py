"""Solvers that CasADi's nlpsol plugins provide: a base, and a class for every supported plugin."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
from typing_extensions import override

from .._util.interrupts import interruptible
from .._util.silence import silence
from .._util.threads import locked_cache, one_at_a_time
from ..errors import SolverError
from ..nlp.black_box import DenseCallback
from ..nlp.program import Instances, LagrangianHessian, Nlp
from ..nlp.solution import Status
from ..typing import FloatArray
from .base import (
    Answer,
    Capabilities,
    IterateLog,
    Iterates,
    NonNegativeInt,
    Positive,
    PositiveInt,
    Solver,
    described,
    settings,
)

INTERRUPTED = "User_Requested_Stop"
"""The return_status of CasADi's own loops after Ctrl-C, which alone stops them."""

_WARM_UP_SECONDS = 0.1  # up to which a recorded solve is repeated

NO_STATUS = "ended without a status"
"""Message of a solve for which the plugin leaves its status empty."""

COMMON: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "record_time": True,
    "calc_lam_p": False,  # unused, and warns when a solve fails
}
"""Options of every plugin: no output, and failures as statuses instead of exceptions."""


class NlpsolSolver(Solver):
    """A solver that CasADi calls, as `backends.toml` describes it.

    Multipliers are CasADi's: positive at an upper bound, like those of `nlp.kkt_residuals`.
    """

    plugin: ClassVar[str]
    statuses: ClassVar[Mapping[str, Status]] = {}
    """Status by return_status, or by CasADi's unified one if the plugin has none."""
    counts: ClassVar[tuple[str, ...]] = ("nlp_f", "nlp_fg")
    """Functions whose calls are the evaluations."""
    uses_hessian: ClassVar[bool] = False
    """Whether the backend is given the program's `LagrangianHessian`, if any."""
    prints_to_stdout: ClassVar[bool] = False
    """Whether the backend prints regardless of its options, and must be silenced."""
    warm_start: ClassVar[Mapping[str, Any]] = {}
    """Options that hold where the instance has multipliers and the solver's fields leave them."""
    needs_constraint_row: ClassVar[bool] = False
    """Whether the backend needs a row in g; where there is none, an unbounded one is added."""

    def plugin_options(self) -> dict[str, Any]:
        """Options of the plugin in addition to `COMMON`."""
        return settings(self)

    @classmethod
    def unavailable(cls) -> str:
        """Reason why the plugin cannot run in this installation of CasADi; empty if it can."""
        return missing_plugin(cls.plugin)

    def status(self, stats: Mapping[str, Any]) -> Status:
        """Status of a solve by CasADi's statistics."""
        return self.statuses.get(_message(stats)) or self._limit(stats)

    @override
    def prepare(self, nlp: Nlp) -> None:
        reason = missing_plugin(self.plugin)
        if reason:
            raise SolverError(f"{self.name} cannot run here: {reason}", solver=self.name)
        _compiled(self, nlp)

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        function = _compiled(self, nlp)
        answers = []
        for i in range(len(instances)):
            warm = bool(_multipliers(instances, i))
            one = _compiled(self, nlp, warm) if warm else function
            answers.append(self._solve(one, instances, i))
        return answers

    @override
    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """Points with which CasADi calls its ``iteration_callback``."""
        log = IterateLog()

        def record(x: FloatArray, *_: FloatArray) -> FloatArray:
            log(x)
            return np.zeros(1)  # continue

        variables, parameters, rows = nlp.sizes
        rows = max(rows, int(self.needs_constraint_row))
        results = variables, 1, rows, variables, rows, parameters + 2  # x, f, g and multipliers
        callback = DenseCallback("iterates", record, results, (1, 1))
        warm = bool(_multipliers(instance, 0))
        function = _built(self, nlp, {"iteration_callback": callback}, warm)
        answer = self._solve(function, instance, 0)
        if answer.seconds < _WARM_UP_SECONDS:  # the first call of a function takes longer
            log = IterateLog()
            answer = self._solve(function, instance, 0)
        reports_start = log.count > answer.iterations
        x0 = instance.x0[0]
        return log.iterates(x0[:0] if reports_start else x0, instance.scale[0, 0])

    @one_at_a_time
    def _solve(self, function: Any, instances: Instances, i: int) -> Answer:
        started = time.perf_counter()
        rows = instances.lbg.shape[1]
        free = self.needs_constraint_row and not rows
        length, value = instances.scale[i]
        try:
            with interruptible(), silence() if self.prints_to_stdout else nullcontext():
                out = function(
                    x0=instances.x0[i] / length,
                    p=np.concatenate([instances.p[i], instances.scale[i]]),
                    lbx=instances.lbx[i] / length,
                    ubx=instances.ubx[i] / length,
                    lbg=-np.inf if free else instances.lbg[i],
                    ubg=np.inf if free else instances.ubg[i],
                    **({} if free else _multipliers(instances, i)),
                )
        except RuntimeError as error:  # CasADi's, for example on NaN bounds
            seconds = time.perf_counter() - started
            return Answer(instances.x0[i], Status.FAILED, _reason(error), 0, 0, seconds)
        seconds = time.perf_counter() - started
        stats = _stats(function)
        message = _message(stats)
        if message == INTERRUPTED:
            raise KeyboardInterrupt
        x, lam_x, lam_g = (np.asarray(out[name]).ravel() for name in ("x", "lam_x", "lam_g"))
        evaluations = sum(int(stats.get(f"n_call_{name}", 0)) for name in self.counts)
        counts = int(stats.get("iter_count", 0)), evaluations
        answer = Answer(x, self.status(stats), message, *counts, seconds, (lam_x, lam_g[:rows]))
        return answer.in_units(length, value)

    def _limit(self, stats: Mapping[str, Any]) -> Status:
        """The limit that stopped the plugin, where only CasADi's unified status tells of one."""
        if stats["unified_return_status"] != "SOLVER_RET_LIMITED":
            return Status.FAILED
        if "iter_count" in stats:
            late = stats["iter_count"] < getattr(self, "max_iter", 0)
        else:
            late = stats["t_wall_total"] >= getattr(self, "time_limit", math.inf)
        return Status.TIME_LIMIT if late else Status.ITERATION_LIMIT


@locked_cache(maxsize=64)
def has_plugin(plugin: str) -> bool:
    """Return True if this installation of CasADi can load an nlpsol plugin."""
    return bool(ca.has_nlpsol(plugin))


def missing_plugin(plugin: str) -> str:
    """Reason why a plugin cannot run in this installation of CasADi; empty if it can."""
    if has_plugin(plugin):
        return ""
    return f"the nlpsol plugin {plugin!r} is not in this casadi ({version('casadi')})"


def _stats(function: Any) -> dict[str, Any]:
    """Statistics of the last call; CasADi raises where a plugin has left its status empty."""
    try:
        return dict(function.stats())
    except RuntimeError:
        return dict.fromkeys(("return_status", "unified_return_status"), NO_STATUS)


def _message(stats: Mapping[str, Any]) -> str:
    """The plugin's own status, or CasADi's unified one if it has none."""
    return str(stats.get("return_status", stats["unified_return_status"]))


def _reason(error: RuntimeError) -> str:
    """The last line of CasADi's error, which says what happened; the others are a traceback."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else "error without a message"


def _multipliers(instances: Instances, i: int) -> dict[str, FloatArray]:
    """Initial multipliers of an instance in units of its scale; empty if it has none."""
    if instances.lam_x0 is None or instances.lam_g0 is None:
        return {}
    length, value = instances.scale[i]
    lam_x0, lam_g0 = instances.lam_x0[i] * length / value, instances.lam_g0[i] / value
    known = np.isfinite(lam_x0).all() and np.isfinite(lam_g0).all()
    return {"lam_x0": lam_x0, "lam_g0": lam_g0} if known else {}


@locked_cache(maxsize=64)
def _compiled(solver: NlpsolSolver, nlp: Nlp, warm: bool = False) -> Any:
    return _built(solver, nlp, {}, warm)


@one_at_a_time
def _built(solver: NlpsolSolver, nlp: Nlp, more: Mapping[str, Any], warm: bool) -> Any:
    """CasADi's solver of a program in units of its scale; `warm` if it starts from multipliers."""
    options = {"expand": nlp.unroll, **COMMON, **solver.plugin_options(), **more}
    for key, entries in (solver.warm_start if warm else {}).items():
        options[key] = {**entries, **options[key]}
    x, scale = ca.MX.sym("x", nlp.sizes[0]), ca.MX.sym("scale", 2)  # the last two parameters
    p, (length, value) = ca.vertcat(nlp.p, scale), ca.vertsplit(scale)
    f, g = nlp.evaluate.call([length * x, nlp.p], True, False)
    own, exact = nlp.attached(LagrangianHessian), getattr(solver, "hessian", "exact") == "exact"
    if own is not None and solver.uses_hessian and exact:
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.sizes[2])
        hessian = length**2 * own(length * x, nlp.p, lam_f / value, lam_g)
        options["hess_lag"] = ca.Function("hess_lag", [x, p, lam_f, lam_g], [hessian])
    free = solver.needs_constraint_row and not nlp.sizes[2]
    problem = {"x": x, "p": p, "f": f / value, "g": ca.MX(0) if free else g}
    try:
        with silence() if solver.prints_to_stdout else nullcontext():
            return ca.nlpsol("solver", solver.plugin, problem, options)
    except RuntimeError as error:
        raise SolverError(
            f"{solver.name} cannot solve {nlp.name}: {_reason(error)}",
            solver=solver.name,
            problem=nlp.name,
        ) from error


_UNIFIED = {
    "SOLVER_RET_SUCCESS": Status.SOLVED,
    "SOLVER_RET_INFEASIBLE": Status.INFEASIBLE,
    "SOLVER_RET_LIMITED": Status.ITERATION_LIMIT,
}
"""Status by CasADi's own word for it, which does not tell the limit that was reached."""


@dataclass(frozen=True, eq=False)
class NlpSol(NlpsolSolver):
    """A plugin of `casadi.nlpsol` with the options that it takes there.

    For plugins that need a licence or a library of their own, and for those that casswarm has no
    class for. A success is what CasADi calls one, so that limits that the plugin confuses with
    successes are counted as such, unless the recomputed residuals contradict.

    Parameters
    ----------
    plugin : str
        Such as madnlp, knitro or snopt.
    options : mapping
        The plugin's options, such as ``{"madnlp": {"tol": 1e-8}}``.

    Examples
    --------
    >>> import casswarm as csw
    >>> csw.solvers.NlpSol("sqpmethod", {"qpsol": "qrqp", "max_iter": 50}).name
    'sqpmethod'
    """

    plugin: str  # type: ignore[misc]
    options: Mapping[str, Any] = field(default_factory=dict)

    summary: ClassVar[str] = "a plugin of CasADi's nlpsol by name; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True)
    prints_to_stdout: ClassVar[bool] = True  # many do unless told otherwise
    statuses: ClassVar[dict[str, Status]] = {}

    @property
    def name(self) -> str:  # type: ignore[override]
        """The plugin's name."""
        return self.plugin

    @override
    def plugin_options(self) -> dict[str, Any]:
        return dict(self.options)

    @override
    def status(self, stats: Mapping[str, Any]) -> Status:
        return _UNIFIED.get(str(stats["unified_return_status"]), Status.FAILED)


@described
@dataclass(frozen=True)
class Ipopt(NlpsolSolver):
    """Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), with MUMPS.

    Parameters
    ----------
    tolerance : float
        Ipopt's ``tol`` and ``constr_viol_tol``.
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    hessian : {"exact", "limited-memory"}
    memory : int
        Number of steps in the limited-memory approximation.
    mu_strategy : {"monotone", "adaptive"}
    constraint_tolerance : float, optional
        Ipopt's ``constr_viol_tol``; by default that of ``tol``.
    bound_push : float, optional
        Relative distance by which the initial guess is moved away from its bounds: Ipopt's
        ``bound_push``, ``bound_frac`` and their like for slacks, 0.01 by default.
    mu_init : float, optional
        Initial barrier parameter, 0.1 by default: a smaller one stays nearer to a good guess.
    print_level : int
        Ipopt's, from 0: how much it prints on standard output; 5 prints a line per iteration.
    """

    tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    time_limit: Positive = 60.0
    hessian: Literal["exact", "limited-memory"] = "exact"
    memory: PositiveInt = 6
    mu_strategy: Literal["monotone", "adaptive"] = "monotone"
    constraint_tolerance: Positive | None = None
    bound_push: Positive | None = None
    mu_init: Positive | None = None
    print_level: NonNegativeInt = 0

    @override
    def warm(self) -> Ipopt:
        """With a small initial barrier parameter, which keeps it near its initial guess."""
        return self if self.mu_init is not None else replace(self, mu_init=1e-4)

    @override
    def from_feasible_guess(self) -> tuple[Ipopt, ...]:
        """Hardly pushed away from bounds, hardly a barrier.

        Whether Ipopt then finds such a set is chance, but rarely for all of these settings.
        """
        return tuple(
            replace(self, bound_push=push, mu_init=barrier)
            for push, barrier in ((1e-10, 1e-8), (1e-4, 1e-6), (1e-8, 1e-9))
        )


@described
@dataclass(frozen=True)
class Sleqp(NlpsolSolver):
    """SLEQP (after Byrd, Gould, Nocedal, Waltz, Math. Program. 100(1), 2004), damped BFGS.

    The plugin has no option for the tolerance: it is 1e-6, on stationarity relative to
    multipliers.

    Parameters
    ----------
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    """

    max_iter: PositiveInt = 1000
    time_limit: Positive = 60.0


@described
@dataclass(frozen=True)
class Sqp(NlpsolSolver):
    """CasADi's ``sqpmethod``: line search on a merit function, elastic where a QP is infeasible.

    BFGS and the exact Hessian solve about as many problems, BFGS in half the time. The exact one is
    made positive definite by a multiple of the identity, after Gershgorin. CasADi can reflect or
    clip its eigenvalues too, but does not always find them, and then stops without a status.

    Parameters
    ----------
    tolerance : float
        Of primal and dual infeasibility.
    max_iter : int
    hessian : {"limited-memory", "exact"}
        BFGS, or exact and convexified.
    qp_solver : {"qpoases", "qrqp", "daqp", "osqp"}
    """

    tolerance: Positive = 1e-6
    max_iter: PositiveInt = 500
    hessian: Literal["exact", "limited-memory"] = "limited-memory"
    qp_solver: Literal["qpoases", "qrqp", "daqp", "osqp"] = "qpoases"

    qp_options: ClassVar[Mapping[str, dict[str, Any]]]

    @override
    def plugin_options(self) -> dict[str, Any]:
        options = settings(self)
        options["qpsol_options"] = {"error_on_fail": False, **self.qp_options[self.qp_solver]}
        if self.hessian == "exact":
            options["convexify_strategy"] = "regularize"
        return options


@described
@dataclass(frozen=True)
class Uno(NlpsolSolver):
    """Uno (Vanaret, Leyffer, arXiv:2406.13454) as its preset ``filtersqp`` composes it.

    Parameters
    ----------
    tolerance : float
        Uno's ``primal_tolerance`` and ``dual_tolerance``; the latter is scaled by multipliers.
    max_iter : int
    time_limit : float
        CPU time of one solve, in seconds.
    """

    tolerance: Positive = 1e-7
    max_iter: PositiveInt = 500
    time_limit: Positive = 60.0


@described
@dataclass(frozen=True)
class Alpaqa(NlpsolSolver):
    """ALM and PANOC with L-BFGS (Pas, Schuurmans, Patrinos, ECC 2022); first derivatives only.

    The plugin does not report its iterations, which are counted as zero; its evaluations are those
    of the augmented Lagrangian.

    Parameters
    ----------
    tolerance : float
        On stationarity and on the constraints.
    max_iter : int
        Updates of the multipliers.
    max_inner_iter : int
        PANOC iterations between two updates.
    time_limit : float
        Wall time of one solve, in seconds.
    """

    tolerance: Positive = 1e-8
    max_iter: PositiveInt = 100
    max_inner_iter: PositiveInt = 1000
    time_limit: Positive = 60.0

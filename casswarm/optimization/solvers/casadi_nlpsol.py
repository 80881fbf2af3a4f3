"""Base of the solvers that CasADi's nlpsol plugins provide."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from importlib.metadata import version
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ..._util.interrupts import interruptible
from ..._util.silence import silence
from ..._util.threads import locked_cache, one_at_a_time
from ...errors import SolverError
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Solver
from .iterates import IterateLog, Iterates

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
    """A solver that CasADi calls: a plugin's name, its options, and its statuses.

    Multipliers are CasADi's: positive at an upper bound, like those of `kkt.kkt_residuals`.
    """

    plugin: ClassVar[str]
    statuses: ClassVar[Mapping[str, Status]]
    """Status by return_status, or by CasADi's unified one if the plugin has none."""
    counts: ClassVar[tuple[str, ...]] = ("nlp_f", "nlp_fg")
    """Functions whose calls are the evaluations."""
    uses_hessian: ClassVar[bool] = False
    """Whether the backend is given `Nlp.hessian`, where there is one."""
    prints_to_stdout: ClassVar[bool] = False
    """Whether the backend prints regardless of its options, and must be silenced."""
    needs_constraint_row: ClassVar[bool] = False
    """Whether the backend needs a row in g; where there is none, an unbounded one is added."""

    @abstractmethod
    def plugin_options(self) -> dict[str, Any]:
        """Options of the plugin in addition to `COMMON`."""

    @classmethod
    def unavailable(cls) -> str:
        """Why the plugin cannot run in this installation of CasADi; empty if it can."""
        return missing_plugin(cls.plugin)

    def status(self, stats: Mapping[str, Any]) -> Status:
        """Status of a solve by CasADi's statistics."""
        return self.statuses.get(_message(stats)) or self._limit(stats)

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        reason = missing_plugin(self.plugin)
        if reason:
            raise SolverError(f"{self.name} cannot run here: {reason}")
        _compiled(self, nlp)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        function = _compiled(self, nlp)
        return [self._solve(function, instances, i) for i in range(len(instances))]

    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """See `Solver.iterates`; they are those of CasADi's ``iteration_callback``."""
        callback = _Callback(nlp.sizes, self.needs_constraint_row)
        function = _built(self, nlp, {"iteration_callback": callback})
        answer = self._solve(function, instance, 0)
        if answer.seconds < _WARM_UP_SECONDS:  # the first call of a function takes longer
            callback.log = IterateLog()
            answer = self._solve(function, instance, 0)
        reports_start = callback.log.count > answer.iterations
        x0 = instance.x0[0]
        return callback.log.iterates(x0[:0] if reports_start else x0, instance.scale[0, 0])

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
                )
        except RuntimeError as error:  # CasADi's, for example on NaN bounds
            seconds = time.perf_counter() - started
            return Answer(instances.x0[i], Status.FAILED, _reason(error), 0, 0, seconds)
        seconds = time.perf_counter() - started
        stats = _stats(function)
        message = _message(stats)
        if message == INTERRUPTED:
            raise KeyboardInterrupt
        return Answer(
            x=length * np.asarray(out["x"]).ravel(),
            status=self.status(stats),
            message=message,
            iterations=int(stats.get("iter_count", 0)),
            evaluations=sum(int(stats.get(f"n_call_{name}", 0)) for name in self.counts),
            seconds=seconds,
            multipliers=(
                value / length * np.asarray(out["lam_x"]).ravel(),
                value * np.asarray(out["lam_g"]).ravel()[:rows],
            ),
        )

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
    """Whether this installation of CasADi can load an nlpsol plugin."""
    return bool(ca.has_nlpsol(plugin))


def missing_plugin(plugin: str) -> str:
    """Why a plugin cannot run in this installation of CasADi; empty if it can."""
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


@locked_cache(maxsize=64)
def _compiled(solver: NlpsolSolver, nlp: Nlp) -> Any:
    return _built(solver, nlp, {})


@one_at_a_time
def _built(solver: NlpsolSolver, nlp: Nlp, more: Mapping[str, Any]) -> Any:
    """Solver of the problem in units of `Instances.scale`, which are its last two parameters."""
    options = {"expand": nlp.unroll, **COMMON, **solver.plugin_options(), **more}
    x, scale = ca.MX.sym("x", nlp.sizes[0]), ca.MX.sym("scale", 2)
    p, (length, value) = ca.vertcat(nlp.p, scale), ca.vertsplit(scale)
    f, g = nlp.evaluate.call([length * x, nlp.p], True, False)
    exact = getattr(solver, "hessian", "exact") == "exact"
    if nlp.hessian is not None and solver.uses_hessian and exact:
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.sizes[2])
        hessian = length**2 * nlp.hessian(length * x, nlp.p, lam_f / value, lam_g)
        options["hess_lag"] = ca.Function("hess_lag", [x, p, lam_f, lam_g], [hessian])
    free = solver.needs_constraint_row and not nlp.sizes[2]
    problem = {"x": x, "p": p, "f": f / value, "g": ca.MX(0) if free else g}
    try:
        with silence() if solver.prints_to_stdout else nullcontext():
            return ca.nlpsol("solver", solver.plugin, problem, options)
    except RuntimeError as error:
        raise SolverError(f"{solver.name} cannot solve {nlp.name}: {_reason(error)}") from error


class _Callback(ca.Callback):
    """Records the iterates of a solver that `_built` makes."""

    def __init__(self, sizes: tuple[int, int, int], needs_constraint_row: bool) -> None:
        super().__init__()
        variables, parameters, rows = sizes
        rows = max(rows, int(needs_constraint_row))
        self.log = IterateLog()
        shapes = {"f": 1, "x": variables, "lam_x": variables, "g": rows, "lam_g": rows}
        self._shapes = shapes | {"lam_p": parameters + 2}
        self.construct("iterates", {})

    def get_n_in(self) -> int:
        """Number of outputs of a solver."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """A single one: whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Name of an output of a solver."""
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:  # noqa: ARG002
        """CasADi's own name."""
        return "ret"

    def get_sparsity_in(self, i: int) -> Any:
        """Shape of an output of a solver."""
        return ca.Sparsity.dense(self._shapes[ca.nlpsol_out(i)])

    def eval(self, arguments: Sequence[Any]) -> list[int]:
        """Record x, and continue."""
        self.log(arguments[0])
        return [0]

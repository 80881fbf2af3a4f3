"""Every backend at its limits: options, iterations, time, numbers that are none, Ctrl-C."""

from __future__ import annotations

import pickle
import signal
import sys
from collections.abc import Sequence
from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from available_solvers import GENERAL, each
from backend_cases import Case, formation, guide
from commands import python
from known_problems import active_box, instances

from casswarm.errors import SolverError
from casswarm.nlp import Instances, Nlp, Residuals, Status
from casswarm.solvers import SOLVERS, Answer, Solver, make_solver
from casswarm.solvers.base import failed

NAMES = list(SOLVERS)
TIMED = [name for name in NAMES if SOLVERS[name].capabilities.time_limit]
LIMITS: dict[str, dict[str, Any]] = {
    "alpaqa": {"max_iter": 2, "max_inner_iter": 2},
}
"""Options that stop a backend early; max_iter for the others."""


def hard(name: str) -> Case:
    return guide(4.62) if name in GENERAL else formation("constrained, collisions")


@pytest.mark.parametrize("name", each(NAMES))
def test_options_are_frozen_and_unknown_ones_rejected(name: str) -> None:
    solver = make_solver(name)
    assert is_dataclass(solver)
    first = fields(solver)[0].name
    with pytest.raises(FrozenInstanceError):
        setattr(solver, first, getattr(solver, first))
    with pytest.raises(SolverError) as caught:
        make_solver(name, **{f"{first}x": 1})
    message = str(caught.value)
    assert message.startswith(f"solver {name!r} has no option '{first}x'; did you mean {first!r}?")
    assert all(option.name in message for option in fields(solver))
    assert pickle.loads(pickle.dumps(solver)) == solver
    assert hash(solver) == hash(make_solver(name))


@pytest.mark.parametrize("name", each(n for n in NAMES if n != "auto"))
def test_options_out_of_range_are_rejected(name: str) -> None:
    solver = make_solver(name)
    numbers = [
        f.name for f in fields(SOLVERS[name]) if isinstance(getattr(solver, f.name), int | float)
    ]
    assert numbers
    for option in numbers:
        with pytest.raises(SolverError, match=f"{name}: {option} = -1; allowed: "):
            make_solver(name, **{option: -1})


@pytest.mark.parametrize("name", each(n for n in NAMES if n != "spectral"))  # which wants sets
def test_solver_nan_parameter_is_not_success(name: str) -> None:
    """The objective of the second instance is NaN everywhere; the others do not suffer."""
    x, q = ca.MX.sym("x", 2), ca.MX.sym("q")
    nlp = Nlp("root", {"x": x}, {"q": q}, ca.sumsqr(x - ca.sqrt(q)), {})
    batch = instances(np.ones((3, 2)), [[4.0], [-1.0], [9.0]], lbx=-10, ubx=10)
    good, bad, other = make_solver(name).solve(nlp, batch)
    assert (good.status, other.status) == (Status.SOLVED, Status.SOLVED)
    np.testing.assert_allclose([good.x, other.x], [[2, 2], [3, 3]], atol=1e-5)
    assert not bad.status.success
    if name in ("ipopt", "projected-gradient"):
        assert bad.status is Status.FAILED
        assert np.isnan(bad.objective)
    assert bad.residuals == Residuals(np.inf, np.inf, np.inf, "not finite")


@pytest.mark.parametrize("name", each(n for n in NAMES if n != "auto"))
def test_solver_iteration_limit_is_reported(name: str) -> None:
    solution = make_solver(name, **LIMITS.get(name, {"max_iter": 2})).solve(*hard(name))[0]
    assert solution.status is Status.ITERATION_LIMIT, solution
    assert not solution.status.success
    assert solution.message
    assert np.isfinite(solution.residuals.stationarity)


@pytest.mark.parametrize("name", ["ipopt", "projected-gradient"])
def test_single_iteration_is_counted(name: str) -> None:
    case = active_box()
    solution = make_solver(name, max_iter=1).solve(case.nlp, case.instance)[0]
    assert (solution.status, solution.iterations) == (Status.ITERATION_LIMIT, 1)


@pytest.mark.parametrize("name", each(TIMED))
def test_solver_time_limit_is_reported(name: str) -> None:
    solution = make_solver(name, time_limit=1e-3).solve(*guide(10.0))[0]
    assert solution.status is Status.TIME_LIMIT, solution
    assert solution.message
    assert solution.x.shape == guide(10.0)[1].x0.shape[1:]


def test_solvers_without_time_limit_have_no_option() -> None:
    assert set(GENERAL) - set(TIMED) == {"auto", "interior-point", "sqp"}


@pytest.mark.parametrize("apart", [0.0, 1.0])
@pytest.mark.parametrize("name", each([*GENERAL, "projected-gradient"]))
def test_all_solvers_reject_crossing_bounds(name: str, apart: float) -> None:
    case = active_box()
    bounds = {"lbx": case.instance.ubx + apart, "ubx": case.instance.lbx}
    solution = make_solver(name).solve(case.nlp, replace(case.instance, **bounds))[0]
    assert not solution.status.success
    assert solution.message
    if name in ("ipopt", "projected-gradient"):
        assert solution.status is Status.FAILED
        assert solution.residuals.violation > 0


INTERRUPTED = """
import os, signal, sys, threading, time
sys.path.insert(0, {tests!r})
from available_solvers import GENERAL, each
from backend_cases import guide
from casswarm.solvers import make_solver

for name in {names!r}:
    solver, case = make_solver(name), guide(10.0)
    solver.prepare(case[0])
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    end = time.monotonic() + 30
    timer.start()
    try:
        while time.monotonic() < end:
            solver.solve(*case)
        print(name, "swallowed it")
    except KeyboardInterrupt:
        print(name, "stopped")
"""


def test_ctrl_c_stops_every_solver() -> None:
    names = [name for name in GENERAL if not SOLVERS[name].unavailable()]
    script = INTERRUPTED.format(tests=str(Path(__file__).parents[1] / "helpers"), names=names)
    done = python("-c", script, timeout=240)
    assert done.stdout.splitlines() == [f"{name} stopped" for name in names]


@dataclass(frozen=True)
class Suppressing(Solver):
    """A solver whose code loses an interrupt, as compiled conversions of arguments may."""

    raised: type[Exception] | None

    name: ClassVar[str] = "suppressing"
    summary: ClassVar[str] = "suppresses Ctrl-C"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:  # noqa: ARG002
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            if self.raised is not None:
                raise self.raised("masks the interrupt") from None
        return failed(instances, "no interrupt reached the caller")


@pytest.mark.parametrize("raised", [None, TypeError])
def test_suppressed_ctrl_c_stops_solve(raised: type[Exception] | None) -> None:
    nlp, instance = active_box().nlp, active_box().instance
    with pytest.raises(KeyboardInterrupt):
        Suppressing(raised).solve(nlp, instance)


@dataclass(frozen=True)
class Leaving(Solver):
    """A solver whose code ends the interpreter, when it builds a problem or when it solves one."""

    building: bool

    name: ClassVar[str] = "leaving"
    summary: ClassVar[str] = "calls sys.exit"

    def prepare(self, nlp: Nlp) -> None:  # noqa: ARG002
        if self.building:
            sys.exit(0)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:  # noqa: ARG002
        sys.exit(0)


@pytest.mark.parametrize(("building", "words"), [(True, "building raised"), (False, "raised")])
def test_exit_in_solver_is_failed_solution(building: bool, words: str) -> None:
    nlp, instance = active_box().nlp, active_box().instance
    solution = Leaving(building).solve(nlp, instance)[0]
    assert solution.status is Status.FAILED
    assert solution.message.startswith(f"{words} SystemExit")

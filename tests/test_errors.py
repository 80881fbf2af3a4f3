"""Errors carry the values of their messages, as attributes that their classes declare."""

from __future__ import annotations

import ast
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import casswarm as csw
from casswarm import errors
from casswarm.comparison import make_problems
from casswarm.envs import SwarmVectorEnv

ROOT = Path(__file__).resolve().parents[1]
SCENARIO = csw.load_scenario("paper-1")
RADARS = ((0.0, 0.0),)
X = ca.SX.sym("x", 2)
BOWL = {"x": X, "f": ca.sumsqr(X)}
SATURATION: dict[str, Any] = {"alpha_1": 4.0, "alpha_2": 3.0, "alpha_3": 4.0}


def saturation(**values: Any) -> csw.Saturation:
    """Rates of one radar, with other values."""
    return csw.Saturation(**{"radars": RADARS, **SATURATION, **values})


def one_rate(positions: ca.MX, _alive: ca.MX) -> ca.MX:
    """Return a single rate, whatever the number of members."""
    return positions[0, 0] ** 2


def negative(positions: ca.MX, _alive: ca.MX) -> ca.MX:
    """Return negative rates."""
    return -1 - positions[:, 0] ** 2


def bounded(lower: np.ndarray, _upper: np.ndarray) -> np.ndarray:
    """Return a number that is no lower bound."""
    return np.full(lower.shape[:-1], 1e9)


def parametric(function: Any, parameters: Any) -> csw.ParametricPolicy:
    """Return a policy of paper-1."""
    return csw.ParametricPolicy(function, parameters, SCENARIO)


Refusal = tuple[Callable[[], object], dict[str, Any]]
REFUSALS: dict[type[errors.CasswarmError], dict[str, Refusal]] = {
    errors.ScenarioError: {
        "unknown scenario": (
            lambda: csw.load_scenario("paper-9"),
            {"value": "paper-9", "file": Path("paper-9")},
        ),
        "scenario key": (
            lambda: SCENARIO.with_values({"formation.rho": -1}),
            {"key": "formation.rho", "value": -1},
        ),
        "sweep without values": (
            lambda: csw.sweep(SCENARIO, {"formation.rho": []}),
            {"key": "formation.rho", "value": []},
        ),
        "sweep of a wrong value": (
            lambda: csw.sweep(SCENARIO, {"formation.rho": [1j]}),
            {"key": "formation.rho", "value": [1j]},
        ),
        "sweep of an unknown key": (
            lambda: csw.sweep(SCENARIO, {"formation.roh": [1.0]}),
            {"key": "formation.roh"},
        ),
    },
    errors.HazardError: {
        "shape of radars": (
            lambda: saturation(radars=((0.0, 0.0, 0.0),)),
            {"key": "radars", "shape": (1, 3)},
        ),
        "texts as radars": (
            lambda: saturation(radars="here"),
            {"key": "radars", "value": "'here'"},
        ),
        "infinite radars": (
            lambda: saturation(radars=((np.inf, 0.0),)),
            {"key": "radars", "value": ((np.inf, 0.0),)},
        ),
        "no radars": (lambda: saturation(radars=()), {"key": "radars"}),
        "a wrong parameter of rates": (
            lambda: saturation(alpha_2=-1.0),
            {"key": "alpha_2", "value": -1.0},
        ),
        "a strength too many": (
            lambda: saturation(strengths=(1.0, 2.0)),
            {"key": "strengths", "value": (1.0, 2.0), "expected": 1},
        ),
        "a negative strength": (
            lambda: saturation(strengths=(-1.0,)),
            {"key": "strengths", "value": (-1.0,)},
        ),
        "shape of positions": (
            lambda: saturation().rates([1.0, 2.0]),
            {"key": "positions", "shape": (2,)},
        ),
        "shape of alive": (
            lambda: saturation().rates([[1.0, 2.0]], [True, False]),
            {"key": "alive", "shape": (2,), "expected": (1,)},
        ),
        "positions that are not finite": (
            lambda: saturation().rates([[np.nan, 2.0]]),
            {"key": "positions"},
        ),
        "shape of points": (
            lambda: saturation().single_agent_rates([1.0, 2.0, 3.0]),
            {"key": "points", "shape": (3,)},
        ),
        "negative rates": (
            lambda: csw.CustomHazard(negative).rates([[2.0, 1.0]]),
            {"hazard": "hazard 'negative'", "state": 0, "member": 0, "rate": -5.0}
            | {"position": (2.0, 1.0)},
        ),
        "one rate for two members": (
            lambda: csw.CustomHazard(one_rate),
            {"hazard": "hazard 'one_rate'", "members": 2, "shape": (1, 1), "expected": (2, 1)},
        ),
        "rates that are no function": (
            lambda: csw.CustomHazard(3),  # type: ignore[arg-type]
            {"function": "3"},
        ),
        "unknown arguments of rates": (
            lambda: csw.CustomHazard(negative, parameters={"alpha_1": 1.0}),
            {"value": ["alpha_1"], "expected": ["positions", "_alive"]},
        ),
        "a bound above the rate": (
            lambda: csw.CustomHazard(
                lambda x, _alive: x[:, 0] ** 2, lower_bound=bounded
            ).single_agent_lower_bound(np.zeros((1, 2)), np.ones((1, 2))),
            {"bound": 1e9, "rate": 0.0, "position": (0.0, 0.0)},
        ),
    },
    errors.PolicyError: {
        "unknown policy": (lambda: csw.make_policy("lider", SCENARIO), {"policy": "lider"}),
        "name as a scenario": (
            lambda: csw.as_policy(lambda *_: None, "mine"),  # type: ignore[arg-type]
            {"key": "scenario", "value": "mine"},
        ),
        "class of a policy": (
            lambda: csw.as_policy(csw.ParametricPolicy),
            {"policy": "ParametricPolicy"},
        ),
        "shape of parameters": (
            lambda: parametric(lambda *_: None, [[1.0]]),
            {"key": "parameters", "shape": (1, 1)},
        ),
        "parameters of no number": (
            lambda: parametric(lambda *_: None, "many"),
            {"key": "parameters", "value": "'many'"},
        ),
        "several policies at a time": (
            lambda: csw.evaluate(SCENARIO, ["leader", "naive"]),  # type: ignore[arg-type]
            {"policies": ["leader", "naive"]},
        ),
        "tolerance 0 for a large swarm": (
            lambda: csw.evaluate(csw.load_scenario("large-swarm"), "leader", tolerance=0.0),
            {"scenario": "large-swarm", "members": csw.load_scenario("large-swarm").n},
        ),
        "gradient of a named policy": (
            lambda: csw.success_gradient(SCENARIO, "leader"),  # type: ignore[arg-type]
            {"policy": "str"},
        ),
    },
    errors.SolverError: {
        "search of a guide": (
            lambda: csw.plan(SCENARIO, search="everywhere"),  # type: ignore[arg-type]
            {"search": "everywhere"},
        ),
        "options of a solver that is made": (
            lambda: csw.make_solver(csw.solvers.Ipopt(), max_iter=3),
            {"solver": "ipopt", "option": "max_iter"},
        ),
    },
    errors.ProblemError: {
        "start that is no number": (
            lambda: csw.Problem.from_casadi(BOWL, "bowl", x0=[1, np.nan]),
            {"problem": "bowl", "start": "given", "key": "x0"},
        ),
        "bounds that cross": (
            lambda: csw.Problem.from_casadi(BOWL, "bowl", lbx=2, ubx=1),
            {"problem": "bowl", "value": (2.0, 1.0)},
        ),
        "start of another size": (
            lambda: csw.Problem.from_casadi(BOWL, "bowl", x0=[1, 2, 3]),
            {"problem": "bowl", "key": "x0", "value": 3, "expected": 2},
        ),
    },
    errors.PlanningError: {
        "guide within no time": (lambda: csw.plan(SCENARIO, time_limit=1e-9), {"time_limit": 1e-9}),
    },
    errors.EnvError: {
        "discount": (
            lambda: SwarmVectorEnv(SCENARIO, 2, discount=0.0),
            {"key": "discount", "value": 0.0},
        ),
        "number of environments": (
            lambda: SwarmVectorEnv(SCENARIO, 0),
            {"key": "num_envs", "value": 0},
        ),
    },
    errors.ComparisonError: {
        "unknown family": (lambda: make_problems("quikc"), {"family": "quikc"}),
        "no problem of a family": (lambda: make_problems("quick", 0), {"key": "count", "value": 0}),
        "formations of one member": (
            lambda: csw.formation_problems(csw.load_scenario("single-agent")),
            {"scenario": "single-agent"},
        ),
        "formations of planned paths": (
            lambda: csw.formation_problems(SCENARIO, ["joint"]),
            {"policy": "joint"},
        ),
        "solvers of the same name": (
            lambda: csw.compare([], [csw.solvers.Ipopt(), csw.solvers.Ipopt(max_iter=3)]),
            {"solver": "ipopt"},
        ),
        "copies of a problem": (
            lambda: csw.compare([], "ipopt", copies=-1),
            {"key": "copies", "value": -1},
        ),
        "tolerance below zero": (
            lambda: csw.Tolerances(objective=-1),
            {"key": "objective", "value": -1},
        ),
    },
}


@pytest.mark.parametrize(
    ("kind", "refusal"), [(kind, name) for kind in REFUSALS for name in REFUSALS[kind]]
)
def test_refusal_carries_its_values_also_when_pickled(
    kind: type[errors.CasswarmError], refusal: str
) -> None:
    function, values = REFUSALS[kind][refusal]
    with pytest.raises(kind) as caught:
        function()
    assert type(caught.value) is kind
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert {name: getattr(error, name) for name in values} == values
        assert str(error) == str(caught.value)


def test_value_that_an_error_is_not_about_is_none() -> None:
    assert csw.PlanningError("no guide found").time_limit is None


def declared(kind: type) -> set[str]:
    """Names of the values that a class of errors and its bases declare."""
    return {name for base in kind.__mro__ for name in vars(base).get("__annotations__", {})}


def given(folder: str) -> Iterator[tuple[str, str, str]]:
    """Class, value and place of every value that an error is raised with."""
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                kind = {"call_error": "PolicyCallError"}.get(node.func.id, node.func.id)
                found = getattr(errors, kind, None)
                if isinstance(found, type) and issubclass(found, errors.CasswarmError):
                    names = (keyword.arg for keyword in node.keywords if keyword.arg)
                    yield from ((kind, name, f"{path.name}:{node.lineno}") for name in names)


@pytest.mark.parametrize("folder", ["casswarm", "cli", "problems"])
def test_every_value_of_an_error_is_declared(folder: str) -> None:
    undeclared = [
        (kind, name, place)
        for kind, name, place in given(folder)
        if name not in declared(getattr(errors, kind))
    ]
    assert undeclared == []

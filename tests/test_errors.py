"""Errors carry the values of their messages, as attributes that their classes declare."""

from __future__ import annotations

import ast
import pickle
from collections.abc import Callable, Iterator
from functools import partial
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
RADARS, INF = ((0.0, 0.0),), np.inf
X = ca.SX.sym("x", 2)
BOWL = {"x": X, "f": ca.sumsqr(X)}
SATURATION: dict[str, Any] = {"alpha_1": 4.0, "alpha_2": 3.0, "alpha_3": 4.0}


def saturation(key: str = "alpha_1", value: Any = 4.0) -> csw.Saturation:
    """Rates of one radar, with another value."""
    return csw.Saturation(**{"radars": RADARS, **SATURATION, key: value})


def sweep(key: str, values: list[Any]) -> csw.Sweep:
    """Return a sweep of paper-1."""
    return csw.sweep(SCENARIO, {key: values})


def bowl(**values: Any) -> csw.Problem:
    """Return a problem of two variables."""
    return csw.Problem.from_casadi(BOWL, "bowl", **values)


def one_rate(positions: ca.MX, _alive: ca.MX) -> ca.MX:
    """Return a single rate, whatever the number of members."""
    return positions[0, 0] ** 2


def negative(positions: ca.MX, _alive: ca.MX) -> ca.MX:
    """Return negative rates."""
    return -1 - positions[:, 0] ** 2


def bounded(lower: np.ndarray, _upper: np.ndarray) -> np.ndarray:
    """Return a number that is no lower bound."""
    return np.full(lower.shape[:-1], 1e9)


def nameless() -> str:
    """Return the text of a scenario whose rates a file cannot name."""
    return SCENARIO.with_hazard(lambda x, _alive: x[:, 0] ** 2).to_toml()


def parametric(function: Any, parameters: Any) -> csw.ParametricPolicy:
    """Return a policy of paper-1."""
    return csw.ParametricPolicy(function, parameters, SCENARIO)


def bound_above() -> object:
    """Return a lower bound above the rate."""
    hazard = csw.CustomHazard(lambda x, _alive: x[:, 0] ** 2, lower_bound=bounded)
    return hazard.single_agent_lower_bound(np.zeros((1, 2)), np.ones((1, 2)))


LARGE, IPOPT = csw.load_scenario("large-swarm"), csw.solvers.Ipopt()
Refusal = tuple[Callable[..., object], tuple[Any, ...], dict[str, Any]]
REFUSALS: dict[type[errors.CasswarmError], list[Refusal]] = {  # calls, and values of their errors
    errors.ScenarioError: [
        (csw.load_scenario, ("paper-9",), {"value": "paper-9", "file": Path("paper-9")}),
        (SCENARIO.with_values, ({"formation.rho": -1},), {"key": "formation.rho", "value": -1}),
        (sweep, ("formation.rho", []), {"key": "formation.rho", "value": []}),
        (sweep, ("formation.rho", [1j]), {"key": "formation.rho", "value": [1j]}),
        (sweep, ("formation.roh", [1.0]), {"key": "formation.roh"}),
        (nameless, (), {"key": "hazard.kind"}),
    ],
    errors.HazardError: [
        (saturation, ("radars", ((0.0, 0.0, 0.0),)), {"key": "radars", "shape": (1, 3)}),
        (saturation, ("radars", "here"), {"key": "radars", "value": "'here'"}),
        (saturation, ("radars", ((INF, 0.0),)), {"key": "radars", "value": ((INF, 0.0),)}),
        (saturation, ("radars", ()), {"key": "radars"}),
        (saturation, ("alpha_2", -1.0), {"key": "alpha_2", "value": -1.0}),
        (saturation, ("strengths", (1, 2)), {"key": "strengths", "value": (1, 2), "expected": 1}),
        (saturation, ("strengths", (-1.0,)), {"key": "strengths", "value": (-1.0,)}),
        (saturation().rates, ([1.0, 2.0],), {"key": "positions", "shape": (2,)}),
        (
            saturation().rates,
            ([[1.0, 2.0]], [True, False]),
            {"key": "alive", "shape": (2,), "expected": (1,)},
        ),
        (saturation().rates, ([[np.nan, 2.0]],), {"key": "positions"}),
        (saturation().single_agent_rates, ([1.0, 2.0, 3.0],), {"key": "points", "shape": (3,)}),
        (
            csw.CustomHazard(negative).rates,
            ([[2.0, 1.0]],),
            {"hazard": "hazard 'negative'", "state": 0, "member": 0, "rate": -5.0}
            | {"position": (2.0, 1.0)},
        ),
        (
            csw.CustomHazard,
            (one_rate,),
            {"hazard": "hazard 'one_rate'", "members": 2, "shape": (1, 1), "expected": (2, 1)},
        ),
        (csw.CustomHazard, (3,), {"function": "3"}),
        (
            partial(csw.CustomHazard, parameters={"alpha_1": 1.0}),
            (negative,),
            {"value": ["alpha_1"], "expected": ["positions", "_alive"]},
        ),
        (bound_above, (), {"bound": 1e9, "rate": 0.0, "position": (0.0, 0.0)}),
    ],
    errors.PolicyError: [
        (csw.make_policy, ("lider", SCENARIO), {"policy": "lider"}),
        (csw.as_policy, (lambda *_: None, "mine"), {"key": "scenario", "value": "mine"}),
        (csw.as_policy, (csw.ParametricPolicy,), {"policy": "ParametricPolicy"}),
        (parametric, (lambda *_: None, [[1.0]]), {"key": "parameters", "shape": (1, 1)}),
        (parametric, (lambda *_: None, "many"), {"key": "parameters", "value": "'many'"}),
        (csw.evaluate, (SCENARIO, ["leader", "naive"]), {"policies": ["leader", "naive"]}),
        (csw.evaluate, (LARGE, "leader", 0.0), {"scenario": "large-swarm", "members": LARGE.n}),
        (csw.success_gradient, (SCENARIO, "leader"), {"policy": "str"}),
    ],
    errors.SolverError: [
        (partial(csw.plan, search="everywhere"), (SCENARIO,), {"search": "everywhere"}),
        (
            partial(csw.make_solver, max_iter=3),
            (IPOPT,),
            {"solver": "ipopt", "option": "max_iter"},
        ),
    ],
    errors.ProblemError: [
        (partial(bowl, x0=[1, np.nan]), (), {"problem": "bowl", "start": "given", "key": "x0"}),
        (partial(bowl, lbx=2, ubx=1), (), {"problem": "bowl", "value": (2.0, 1.0)}),
        (
            partial(bowl, x0=[1, 2, 3]),
            (),
            {"problem": "bowl", "key": "x0", "value": 3, "expected": 2},
        ),
    ],
    errors.PlanningError: [
        (partial(csw.plan, time_limit=1e-9), (SCENARIO,), {"time_limit": 1e-9}),
    ],
    errors.EnvError: [
        (partial(SwarmVectorEnv, discount=0.0), (SCENARIO, 2), {"key": "discount", "value": 0.0}),
        (SwarmVectorEnv, (SCENARIO, 0), {"key": "num_envs", "value": 0}),
    ],
    errors.ComparisonError: [
        (make_problems, ("quikc",), {"family": "quikc"}),
        (make_problems, ("quick", 0), {"key": "count", "value": 0}),
        (
            csw.formation_problems,
            (csw.load_scenario("single-agent"),),
            {"scenario": "single-agent"},
        ),
        (csw.formation_problems, (SCENARIO, ["joint"]), {"policy": "joint"}),
        (csw.compare, ([], [IPOPT, csw.solvers.Ipopt(max_iter=3)]), {"solver": "ipopt"}),
        (partial(csw.compare, copies=-1), ([], "ipopt"), {"key": "copies", "value": -1}),
        (partial(csw.Tolerances, objective=-1), (), {"key": "objective", "value": -1}),
    ],
}


@pytest.mark.parametrize(
    ("kind", "number"), [(kind, n) for kind, rows in REFUSALS.items() for n in range(len(rows))]
)
def test_refusal_carries_its_values_also_when_pickled(
    kind: type[errors.CasswarmError], number: int
) -> None:
    function, arguments, values = REFUSALS[kind][number]
    with pytest.raises(kind) as caught:
        function(*arguments)
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

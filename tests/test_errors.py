"""Errors carry the values of their messages, as attributes that their classes declare."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from refusals import declared, refused

import casswarm as csw
from casswarm import errors
from casswarm.envs import SwarmVectorEnv

ROOT = Path(__file__).resolve().parents[1]
SCENARIO = csw.load_scenario("paper-1")


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
}


@pytest.mark.parametrize(
    ("kind", "refusal"), [(kind, name) for kind in REFUSALS for name in REFUSALS[kind]]
)
def test_refusal_carries_its_values_also_when_pickled(
    kind: type[errors.CasswarmError], refusal: str
) -> None:
    function, values = REFUSALS[kind][refusal]
    error = refused(kind, function)
    assert {name: getattr(error, name) for name in values} == values


def test_value_that_an_error_is_not_about_is_none() -> None:
    assert csw.PlanningError("no guide found").time_limit is None


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

"""Functions that take a scenario: what they say about a name, a path or anything else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import casswarm as csw

FUNCTIONS: dict[str, Callable[[Any], object]] = {
    "plan": csw.plan,
    "plan_swarm": csw.plan_swarm,
    "simulate": csw.simulate,
    "runs_needed": csw.runs_needed,
    "evaluate": csw.evaluate,
    "estimate": csw.estimate,
    "sweep": lambda value: csw.sweep(value, {"n": [1]}),
    "success_bound": csw.success_bound,
    "make_policy": lambda value: csw.make_policy("leader", value),
    "ValueFunction.from_scenario": csw.ValueFunction.from_scenario,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_name_instead_of_a_scenario_is_refused_with_advice(name: str) -> None:
    with pytest.raises(TypeError) as caught:
        FUNCTIONS[name]("paper-1")
    assert str(caught.value) == (
        f"{name}() needs a Scenario, not the str 'paper-1': "
        "load it first, csw.load_scenario('paper-1')"
    )


def test_path_instead_of_a_scenario_is_refused_with_advice() -> None:
    with pytest.raises(TypeError, match=r"load it first, csw.load_scenario\('mine.toml'\)"):
        csw.plan(Path("mine.toml"))  # type: ignore[arg-type]


def test_other_object_instead_of_a_scenario_is_refused_with_advice() -> None:
    with pytest.raises(TypeError, match=r"not the dict \{'name': 'a'\}: load one with"):
        csw.plan({"name": "a"})  # type: ignore[arg-type]

"""Messages quote what a user gave, and stay readable however long that is."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

import casswarm as csw
from casswarm.comparison import make_problems

LONG = "x" * 100_000
WORDS = "x " * 50_000
SCENARIO = csw.load_scenario("paper-1")
CALLS: dict[str, Callable[[str], object]] = {
    "scenario": csw.load_scenario,
    "policy": lambda text: csw.make_policy(text, SCENARIO),
    "solver": csw.make_solver,
    "search": lambda text: csw.plan(SCENARIO, search=text),  # type: ignore[arg-type]
    "key": lambda text: SCENARIO.with_values({text: 1}),
    "value": lambda text: SCENARIO.with_values({"time.dt": text}),
    "kind": lambda text: SCENARIO.with_values({"hazard.kind": text}),
    "objective": lambda text: csw.plan_swarm(SCENARIO, text),  # type: ignore[arg-type]
    "guess": lambda text: csw.plan_swarm(SCENARIO, initial_guesses=[text]),
    "simulate": lambda text: csw.simulate(SCENARIO, [text], runs=1),
    "option": lambda text: csw.make_solver("ipopt", **{text: 1}),
    "sweep": lambda text: csw.sweep(SCENARIO, {text: [1.0]}),
    "argument": csw.success_bound,  # type: ignore[arg-type]
    "program": csw.Problem.from_nl,
    "theme": lambda text: csw.figures.theme(text).__enter__(),
    "family": make_problems,
    "seed": lambda text: csw.simulate(SCENARIO, "naive", runs=1, seed=text),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("text", [LONG, WORDS], ids=["word", "words"])
@pytest.mark.parametrize("name", CALLS)
def test_message_about_a_long_text_is_short(name: str, text: str) -> None:
    with pytest.raises((csw.CasswarmError, ValueError, TypeError, OSError)) as caught:
        partial(CALLS[name], text)()
    assert len(str(caught.value)) < 6000

"""Accuracy, Execution and progress of long calls: the same in records and as plain keywords."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import casswarm as csw
from casswarm._util.progress import Bars

PAPER = csw.load_scenario("paper-1")
SINGLE = csw.load_scenario("single-agent")
ROUGH = csw.Accuracy(tolerance=0.2, max_states=50)
POLICY = csw.ParametricPolicy(lambda *_: np.zeros((PAPER.n, 2)), [0.0], PAPER)


@pytest.fixture(scope="module")
def guide() -> csw.Guide:
    return csw.plan(PAPER, certify=False, search="local")


def test_records_are_equal_to_plain_keywords(guide: csw.Guide, tmp_path: Path) -> None:
    seen: list[float] = []
    execution = csw.Execution(progress=lambda _, done, __: seen.append(done))
    grouped = csw.evaluate(PAPER, "naive", guide=guide, accuracy=ROUGH, execution=execution)
    plain = csw.evaluate(PAPER, "naive", 0.2, max_states=50, guide=guide)
    assert grouped.success == plain.success
    assert grouped.tolerance == 0.2
    assert seen
    estimates = [
        csw.estimate(PAPER, "naive", 20, guide=guide, accuracy=ROUGH),
        csw.estimate(PAPER, "naive", 20, guide=guide, tolerance=0.2, max_states=50),
    ]
    assert estimates[0].success == estimates[1].success
    planned = csw.plan(PAPER, certify=False, search="local", execution=execution)
    assert np.array_equal(planned.positions, guide.positions)
    saved = csw.Execution(checkpoint=tmp_path, workers=1)
    study = csw.simulate(PAPER, "naive", 20, guide=guide, execution=saved)
    assert study.runs.equals(csw.simulate(PAPER, "naive", 20, guide=guide).runs)
    assert (tmp_path / "checkpoint" / "finished").exists()
    swept = csw.sweep(
        PAPER, {"n": [2]}, "naive", accuracy=ROUGH, execution=csw.Execution(workers=1)
    )
    assert swept.table.equals(
        csw.sweep(PAPER, {"n": [2]}, "naive", tolerance=0.2, max_states=50).table
    )


CALLS: dict[str, Callable[..., Any]] = {
    "evaluate": partial(csw.evaluate, SINGLE, "naive"),
    "estimate": partial(csw.estimate, SINGLE, "naive", 50),
    "sweep": partial(csw.sweep, SINGLE, {"formation.rho": [0.1]}, ["naive"]),
    "markov_chain": partial(csw.markov_chain, PAPER, "naive"),
    "predict_states": partial(csw.predict_states, SINGLE, "naive"),
    "success_gradient": partial(csw.success_gradient, PAPER, POLICY),
    "simulate": partial(csw.simulate, SINGLE, ["naive"], 5),
    "compare": partial(csw.compare, "quick", ["ipopt"], count=1),
    "plan": partial(csw.plan, SINGLE),
    "plan_swarm": partial(csw.plan_swarm, SINGLE),
}
SILENT = ("markov_chain", "predict_states", "success_gradient")  # without progress
REPORTING = {name: call for name, call in CALLS.items() if name not in SILENT}


@pytest.mark.parametrize("name", CALLS)
def test_value_that_is_given_twice_is_named(name: str) -> None:
    exact = name in ("evaluate", "estimate", "sweep", *SILENT)
    twice: dict[str, Any] = {"tolerance": 0.1, "accuracy": ROUGH}
    if not exact:
        twice = {"progress": print, "execution": csw.Execution(progress=False)}
    key, group = twice
    with pytest.raises(TypeError, match=rf"{name}: {key} is given twice, plainly and in {group}="):
        CALLS[name](**twice)


@pytest.mark.parametrize("name", CALLS)
def test_unknown_value_is_named_with_those_allowed(name: str) -> None:
    with pytest.raises(TypeError, match=f"{name} takes no 'tolerence'; allowed: "):
        CALLS[name](tolerence=0.1)
    if name not in ("compare", "plan", "plan_swarm", *SILENT):
        limited = csw.Execution(time_limit=1.0)
        with pytest.raises(TypeError, match=f"{name} takes no 'time_limit'"):
            CALLS[name](execution=limited)


@pytest.mark.parametrize("name", CALLS)
def test_signature_is_short_and_help_names_the_records(name: str) -> None:
    function = getattr(csw, name)
    assert len(inspect.signature(function).parameters) <= 11
    assert "**plain" in inspect.getdoc(function)


# --- progress


@pytest.mark.parametrize("progress", [True, False])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow) if n in {"plan_swarm", "compare"} else n
        for n in REPORTING
    ],
)
def test_progress_is_on_standard_error_if_it_is_asked_for(
    name: str, progress: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    REPORTING[name](progress=progress)
    printed = capsys.readouterr()
    assert bool(printed.err) == progress
    assert not printed.out


@pytest.mark.parametrize("name", REPORTING)
def test_progress_that_is_neither_bool_nor_function_is_refused(name: str) -> None:
    with pytest.raises(TypeError, match="allowed: True for progress bars"):
        REPORTING[name](progress="yes")


def test_bar_that_is_full_is_drawn_once(capsys: pytest.CaptureFixture[str]) -> None:
    report = Bars()
    for done in (0, 5, 10, 10):
        report("runs", done, 10)
    assert capsys.readouterr().err.count("100%") == 1

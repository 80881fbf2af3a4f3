"""Accuracy and Execution: the same as plain keywords, and nothing is given twice."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import casswarm as csw

PAPER = csw.load_scenario("paper-1")
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


CALLS: dict[str, tuple[Any, ...]] = {
    "evaluate": (PAPER,),
    "estimate": (PAPER,),
    "sweep": (PAPER, {"n": [2]}),
    "success_gradient": (PAPER, POLICY),
    "simulate": (PAPER,),
    "compare": ("quick",),
    "plan": (PAPER,),
    "plan_swarm": (PAPER,),
}


@pytest.mark.parametrize("name", CALLS)
def test_value_that_is_given_twice_is_named(name: str) -> None:
    exact = name in ("evaluate", "estimate", "sweep", "success_gradient")
    twice: dict[str, Any] = {"tolerance": 0.1, "accuracy": ROUGH}
    if not exact:
        twice = {"progress": print, "execution": csw.Execution(progress=False)}
    key, group = twice
    with pytest.raises(TypeError, match=rf"{name}: {key} is given twice, plainly and in {group}="):
        getattr(csw, name)(*CALLS[name], **twice)


@pytest.mark.parametrize("name", CALLS)
def test_unknown_value_is_named_with_those_allowed(name: str) -> None:
    with pytest.raises(TypeError, match=f"{name} takes no 'tolerence'; allowed: "):
        getattr(csw, name)(*CALLS[name], tolerence=0.1)
    if name not in ("compare", "plan", "plan_swarm", "success_gradient"):
        limited = csw.Execution(time_limit=1.0)
        with pytest.raises(TypeError, match=f"{name} takes no 'time_limit'"):
            getattr(csw, name)(*CALLS[name], execution=limited)


@pytest.mark.parametrize("name", CALLS)
def test_signature_is_short_and_help_names_the_records(name: str) -> None:
    function = getattr(csw, name)
    assert len(inspect.signature(function).parameters) <= 11
    assert "**plain" in inspect.getdoc(function)

"""Progress bars of long calls."""

import pytest

import casswarm as csw
from casswarm._util.progress import Bars

SCENARIO = csw.load_scenario("single-agent")
CALLS = {
    "plan": lambda progress: csw.plan(SCENARIO, progress=progress),
    "simulate": lambda progress: csw.simulate(SCENARIO, ["naive"], 5, progress=progress),
    "evaluate": lambda progress: csw.evaluate(SCENARIO, "naive", progress=progress),
    "estimate": lambda progress: csw.estimate(SCENARIO, "naive", 50, progress=progress),
    "sweep": lambda progress: csw.sweep(
        SCENARIO, {"formation.rho": [0.1]}, ["naive"], runs=5, progress=progress
    ),
    "plan_swarm": lambda progress: csw.plan_swarm(SCENARIO, progress=progress),
    "compare": lambda progress: csw.compare("quick", ["ipopt"], count=1, progress=progress),
}


NAMES = [pytest.param(n, marks=pytest.mark.slow) if n == "plan_swarm" else n for n in CALLS]


@pytest.mark.parametrize("name", NAMES)
def test_true_reports_on_standard_error(name, capsys):
    CALLS[name](True)
    printed = capsys.readouterr()
    assert printed.err
    assert not printed.out


@pytest.mark.parametrize("name", NAMES)
def test_false_reports_nothing(name, capsys):
    CALLS[name](False)
    printed = capsys.readouterr()
    assert printed.err == printed.out == ""


@pytest.mark.parametrize("name", CALLS)
def test_neither_bool_nor_function_is_refused(name):
    with pytest.raises(TypeError, match="allowed: True for progress bars"):
        CALLS[name]("yes")


def test_bar_that_is_full_is_drawn_once(capsys):
    report = Bars()
    for done in (0, 5, 10, 10):
        report("runs", done, 10)
    assert capsys.readouterr().err.count("100%") == 1

"""Wrong arguments of studies raise before any work: one table of calls, errors and messages."""

from __future__ import annotations

import threading
from datetime import date
from typing import Any

import casadi as ca
import numpy as np
import pytest
from parametric_cases import gradient, scene, steered
from small_scenarios import three_members
from sweep_cases import GRID, SMALL

import casswarm as csw
from casswarm import estimate, evaluate, plan, runs_needed, simulate, success_gradient, sweep
from casswarm import formation_problems as problems
from casswarm.comparison import compare
from casswarm.reproduction import reproduce
from casswarm.scenario.variations import with_parameters

PAPER = csw.load_scenario("paper-1")
QUICK = three_members(guide__search="local", guide__a_max=0.3)
LARGE = csw.load_scenario("large-swarm")
SINGLE = csw.load_scenario("single-agent")
WALL = csw.load_scenario("wall")
PAIR = scene(2)
STEERED = steered(PAIR)
SEEDS = "allowed: whole numbers from 0 to 18446744073709551615"
STUDIES = {
    "simulate": lambda seed: simulate(QUICK, seed=seed),
    "runs_needed": lambda seed: runs_needed(QUICK, seed=seed),
    "estimate": lambda seed: estimate(QUICK, seed=seed),
    "sweep": lambda seed: sweep(QUICK, {"n": [1]}, seed=seed),
    "compare": lambda seed: compare("quick", seed=seed),
    "reproduce": lambda seed: reproduce(seed=seed),
}


def stay(*state: Any) -> Any:
    """Nobody ever arrives."""
    return 0 * state[1]


def onward(*state: Any) -> Any:
    return state[2]


def too_short(*state: Any) -> Any:
    return np.asarray(state[1])[:1, :1]


def cheat(_step: int, _positions: Any, previous_velocities: Any, alive: Any) -> Any:
    alive[:] = True
    return previous_velocities


def waiting_policy() -> Any:
    """A policy that no other process can be sent."""
    lock = threading.Lock()

    def waiting(*state: Any) -> Any:
        with lock:
            return 0 * state[1]

    return waiting


def rooted(_step: int, positions: Any, *others: Any) -> Any:
    return others[-1][0] + 0.01 * ca.sqrt(positions)


REFUSED: dict[type[Exception], list[tuple[Any, str]]] = {
    ValueError: [
        (lambda: simulate(QUICK, runs=0), "runs = 0; allowed: whole numbers from 1"),
        (lambda: simulate(QUICK, runs=2.5), "runs = 2.5; allowed: whole numbers from 1"),
        (lambda: simulate(QUICK, runs=1e3), "runs = 1000.0; allowed: whole numbers from 1"),
        (lambda: simulate(QUICK, workers=0), "workers = 0; allowed: whole numbers from 1"),
        (lambda: simulate(PAPER, [cheat], 5), "read-only"),
        (lambda: evaluate(PAPER, tolerance=1.0), "tolerance"),
        (lambda: evaluate(PAPER, tolerance=-0.1), "tolerance"),
        (lambda: evaluate(PAPER, max_states=0), "max_states"),
        (lambda: evaluate(PAPER, aggregation_tol=-1.0), "aggregation_tol"),
        (lambda: sweep(SMALL, GRID, [stay], workers=0), "or an executor"),
        (lambda: sweep(SMALL, GRID, [stay], workers=-1), "or an executor"),
        (lambda: sweep(SMALL, GRID, [stay], workers=1.5), "or an executor"),
        (lambda: sweep(SMALL, GRID, [stay], workers=None), "or an executor"),
        (lambda: sweep(SMALL, GRID, [stay], workers="two"), "or an executor"),
        (lambda: gradient(PAIR, STEERED, tolerance=1), "tolerance = 1; allowed"),
        (lambda: gradient(PAIR, STEERED, max_states=0), "max_states = 0; allowed"),
        (
            lambda: gradient(PAIR, STEERED, arrival_smoothing=0.6),
            "arrival_smoothing = 0.6; allowed: .* radius, 0.5",
        ),
    ],
    csw.PolicyError: [
        (lambda: simulate(QUICK, ["leeder"]), "did you mean 'leader'"),
        (lambda: simulate(QUICK, ["leader", "leader"]), "repeated: leader"),
        (lambda: simulate(QUICK, [stay, onward, stay]), "repeated: stay"),
        (lambda: simulate(QUICK, []), "no policy given"),
        (lambda: simulate(QUICK, [3]), "3 is not a policy"),
        (
            lambda: simulate(QUICK, [waiting_policy()], 300, workers=2),
            r"'waiting'.* does not pickle.*, or use workers=1",
        ),
        (
            lambda: simulate(QUICK, [too_short], 300, workers=2),
            "policy 'too_short' returned velocities of shape",
        ),
        (
            lambda: simulate(PAPER, ["leader"], 5, guide=plan(SINGLE, certify=False)),
            "plan a guide for this scenario",
        ),
        (lambda: evaluate(PAPER, "leeder"), "did you mean 'leader'"),
        (lambda: evaluate(PAPER, ["leader", "naive"]), "one policy is evaluated at a time, not 2"),
        (lambda: evaluate(LARGE, tolerance=0.0), r"50 members.*give a larger tolerance"),
        (lambda: sweep(SMALL, {"n": [1]}, []), "polic"),
        (lambda: sweep(SMALL, {"n": [1]}, ["leader", "leader"]), "polic"),
        (
            lambda: sweep(SMALL, {"n": [1, 2]}, [waiting_policy()], runs=2, workers=2),
            r"'waiting', .* cannot be sent .* does not pickle",
        ),
        (lambda: success_gradient(PAIR, "leader"), "takes a ParametricPolicy, not str: make one"),
        (lambda: success_gradient(scene(3), STEERED), "other members or limits"),
        (lambda: success_gradient(PAIR, STEERED, [1.0, 2.0]), "has 15 parameters, not 2"),
    ],
    csw.PolicyCallError: [
        (
            lambda: gradient(PAIR, csw.ParametricPolicy(rooted, [1.2], PAIR)),
            "derivative at step 4 that is not finite",
        ),
    ],
    csw.ScenarioError: [
        (lambda: sweep(SMALL, {"formation.rhoo": [1]}), r"(?s)formation\.rhoo.*n and spacing"),
        (lambda: sweep(SMALL, {"formation.rho": []}), "has no values"),
        (lambda: sweep(SMALL, {"formation.rho": "0.1"}), "has no values"),
        (
            lambda: sweep(SMALL, {"formation.rho": [0.1, date(2030, 1, 1)]}),
            "(?s)has a value that no scenario has.*date",
        ),
        (lambda: sweep(SMALL, {"n": [2], "swarm.positions": [[[0.0, 0.0]]]}), "together with n"),
        (lambda: sweep(SMALL, {"n": [1, 1.5]}), "n takes whole numbers, not 1.5"),
        (
            lambda: sweep(SMALL, {"guide.iterations": [1, 1.5]}),
            "guide.iterations takes whole numbers, not 1.5",
        ),
        (lambda: with_parameters(SMALL, {"n": 0}), "allowed"),
        (lambda: with_parameters(SMALL, {"n": 2.5}), "allowed"),
        (lambda: with_parameters(SMALL, {"spacing": -1.0}), "allowed"),
        (lambda: with_parameters(SMALL, {"spacing": 10**400}), "allowed"),
        (lambda: with_parameters(SMALL, {"n": 10**400}), "allowed"),
        (lambda: with_parameters(SMALL, {"n": 10**9}), "1 to 10000"),
        (lambda: with_parameters(SMALL, {"n": 1, "spacing": 1.0}), "two members"),
    ],
    csw.SolverError: [
        (lambda: plan(PAPER, "projected-gradient", search="global"), "straight line"),
    ],
    csw.ComparisonError: [
        (lambda: problems(WALL, ["leader", "naive"]), "policy 'naive' poses no formation"),
        (lambda: problems(WALL, ["leader", "joint"]), "policy 'joint' poses no formation"),
        (
            lambda: problems(WALL, ["leader", "joint-replanning"]),
            "policy 'joint-replanning' poses no formation",
        ),
        (
            lambda: problems(WALL, csw.as_policy(stay), runs=1),
            "policy 'stay': no problem was posed",
        ),
        (lambda: problems(SINGLE), "'single-agent' has a single member"),
        (lambda: csw.guide_problems(WALL, 0), "count = 0; allowed"),
    ],
}


@pytest.mark.parametrize(
    ("error", "call", "message"),
    [
        pytest.param(error, call, message, id=message)
        for error, rows in REFUSED.items()
        for call, message in rows
    ],
)
def test_wrong_arguments_are_explained(error: type[Exception], call: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, 1.0])
@pytest.mark.parametrize("study", STUDIES)
def test_study_with_seed_out_of_range_raises(study: str, seed: object) -> None:
    with pytest.raises(ValueError, match=f"seed = {seed}; {SEEDS}"):
        STUDIES[study](seed)

"""Records, programs, solvers, policies in another process: equal, and with the same numbers."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from known_problems import active_box
from small_scenarios import patrolled, small

import casswarm as csw
from casswarm.comparison import make_problems
from casswarm.formation import CompiledObjective, formation_program
from casswarm.grid import ValueFunction
from casswarm.hazard import CustomHazard, Saturation, SaturationCollision
from casswarm.nlp import Instances, LagrangianHessian, Nlp
from casswarm.problems import JointForm, joint_nlp

PAPER = csw.load_scenario("paper-1")
PAIR = small([(0.0, 0.0), (0.3, 0.2)], (2.2, 0.0), [(1.2, 0.4), (1.6, -0.9)], 6, hazard__alpha_1=8)
FEEDBACK = "leader-feedback", "constrained-feedback"  # which need no guide
RADARS = ((4.4, 4.6), (4.5, 3.0))
POINTS = [[1.0, 2.0], [2.0, 2.0]]


def pickled(value: Any) -> Any:
    """What another process receives."""
    return pickle.loads(pickle.dumps(value))


# --- records with an equality, after a use that compiles what does not pickle


def rates(hazard: csw.Hazard) -> list[float]:
    return list(hazard.rates(POINTS))


def derived(scenario: csw.Scenario) -> tuple[object, ...]:
    return scenario.hazard, scenario.positions.tolist()


def answer(solver: Any) -> list[float]:
    case = active_box()
    return list(solver.solve(case.nlp, case.instance)[0].x)


EQUAL: dict[str, tuple[Any, Callable[[Any], object]]] = {
    "scenario": (PAPER, derived),
    "saturation": (Saturation(RADARS, (1.0, 2.0), alpha_2=1.0), rates),
    "collision": (SaturationCollision(RADARS, (1.0, 2.0), alpha_2=1.0), rates),
    "custom hazard": (CustomHazard(patrolled, RADARS, {"background": 0.3}), rates),
    "ipopt": (csw.make_solver("ipopt", tolerance=1e-7), answer),
    "projected-gradient": (csw.make_solver("projected-gradient", tolerance=1e-7), answer),
}


@pytest.mark.parametrize("name", EQUAL)
@pytest.mark.parametrize("copied", [pickled, copy.copy, copy.deepcopy])
def test_copy_of_record_is_equal_after_its_use(name: str, copied: Callable[[Any], Any]) -> None:
    record, use = EQUAL[name]
    expected = use(record)
    other = copied(record)
    assert other == record
    assert hash(other) == hash(record)
    assert use(other) == expected


# --- programs, problems and values, by their numbers


def derivatives(nlp: Nlp) -> list[object]:
    """Layout of a program, and what it and its attachments are at a point."""
    x, p = (np.linspace(0.2, 0.6, size) for size in nlp.sizes[:2])
    parts = [*nlp.evaluate(x, p), *nlp.gradient(x, p), nlp.jacobian(x, p)]
    compiled, hessian = nlp.attached(CompiledObjective), nlp.attached(LagrangianHessian)
    if hessian is not None:
        parts.append(hessian(x, p, 1.0, np.ones(nlp.sizes[2])))
    numbers = [np.array(ca.DM(part)).tolist() for part in parts]
    assert np.isfinite(np.concatenate([np.ravel(part) for part in numbers])).all()
    source = None if compiled is None else compiled.source
    return [nlp.name, nlp.sizes, nlp.row_names, nlp.unroll, source, *numbers]


def arrays(instances: Instances) -> list[object]:
    """Arrays of instances; compiled code is compiled again for those that can be written to."""
    parts = [getattr(instances, name) for name in ("x0", "p", "lbx", "ubx", "lbg", "ubg")]
    return [(part.tolist(), part.flags.writeable) for part in parts]


def broadcast() -> Instances:
    """Instances with bounds that all share, and with others."""
    rows, free = np.arange(5.0)[:, None], np.full(3, -np.inf)
    lower, upper = np.array([-1.0, -2.0]), rows * [3, 4]
    return Instances(rows * [1, 2], rows, lower, upper, lbg=free, ubg=rows * [5, 6, 7])


def decisions(policy: csw.Policy) -> tuple[str, object]:
    """Decisions in states off every plan, with zero entries of the destroyed."""
    rng, alive = np.random.default_rng(3), np.array([[True, True], [False, True], [True, False]])
    positions, previous_velocities = rng.normal((0.7, 0.2), 0.2, (2, 3, 2, 2))
    living = alive[..., None]
    state = positions * living, previous_velocities * living, alive
    return policy.name, policy.velocities(2, *state).tolist()


NUMBERS: dict[str, tuple[Callable[[], Any], Callable[[Any], object]]] = {
    "formation program": (lambda: formation_program(PAPER.hazard, 5, True), derivatives),
    "joint program": (lambda: joint_nlp(PAPER.hazard, JointForm(3, 4)), derivatives),
    "instances": (broadcast, arrays),
    "problems": (
        lambda: make_problems("quick"),
        lambda problems: [(problem.fingerprint(), problem.traits) for problem in problems],
    ),
    "value function": (
        lambda: ValueFunction.from_scenario(PAIR, 100_000),
        lambda value: value.bounds(0, [0.0, 0.0]),
    ),
    **{name: (partial(csw.make_policy, name, PAIR), decisions) for name in FEEDBACK},
}


@pytest.mark.parametrize("name", NUMBERS)
def test_pickled_program_or_policy_has_the_same_numbers(name: str) -> None:
    make, numbers = NUMBERS[name]
    original = make()
    again = pickled(original)
    assert numbers(again) == numbers(original)

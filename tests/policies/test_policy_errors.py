"""Refused and failing policies: an error that says what is wrong, with policy and step."""

from __future__ import annotations

import sys
import threading
import time
from functools import partial

import numpy as np
import pytest
from parametric_cases import START, scene, steering
from policy_cases import policy
from small_scenarios import three_members

import casswarm as csw
from casswarm import Decision, Policy, PolicyError, SolverError, as_policy, make_policy, simulate
from casswarm.errors import PolicyCallError
from casswarm.policies import Observation, UserPolicy

SCENARIO = three_members()
STATES = np.zeros((3, 3, 2)), np.zeros((3, 3, 2)), np.ones((3, 3), bool)
STILL = np.zeros((3, 3, 2))


def dividing(step, positions, *_):
    return positions * (1 // (step - 2))


def leaving(*_):
    sys.exit(0)


def singular(*_):
    return np.linalg.inv(np.zeros((2, 2)))


def no_such(*_):
    raise IndexError("no such")


def endless(*_):
    while True:
        try:
            time.sleep(0.01)
        except Exception:
            continue


class Returning(Policy):
    """A policy that decides what it is made with, or raises it."""

    name = "returning"

    def __init__(self, decision=None):
        self.decision = decision

    def decide_batch(self, *_):
        if isinstance(self.decision, Exception):
            raise self.decision
        return self.decision


class Nameless(Policy):
    decide_batch = Returning.decide_batch


class Moving:
    """An object with a method `velocities`."""

    def velocities(self, *_):
        return STILL


# --- policies that are not made

ODD = type("Odd", (), {"velocities": 1})
parametric = partial(csw.ParametricPolicy, scenario=scene(3))
made = partial(make_policy, scenario=csw.load_scenario("paper-1"))
observed = partial(Observation.from_scenario, SCENARIO)
REFUSED = [
    (made, ("leader",), {"horizon": 0}, "horizon = 0; allowed: whole numbers from 1"),
    (made, ("leader",), {"horizon": 2.5}, "horizon = 2.5"),
    (made, ("naive",), {"horizon": 3}, "'naive' has no horizon"),
    (made, ("leader-mpc-0",), {}, "horizon = 0"),
    (made, ("leader-mpc-3",), {"horizon": 2}, "includes its horizon"),
    (made, ("leader-mpc-H",), {}, "'leader-mpc-H' is unknown; .*leader-mpc-3"),
    (made, ("leader-mpc-",), {}, "unknown"),
    (made, ("naive-mpc-3",), {}, "unknown"),
    (made, ("leeder",), {}, "policy 'leeder' is unknown; did you mean 'leader'"),
    (made, ("xyz",), {}, "policy 'xyz' is unknown .known: naive, constrained, leader"),
    (made, ("leader",), {"leader_selection": "neerest"}, "did you mean 'nearest'"),
    (made, ("optimal",), {}, "policy 'optimal': .* two members; 'paper-1' has 5"),
    *((as_policy, (x,), {}, "expected a name, a function of") for x in (3, None, {"x": 1}, ODD())),
    (as_policy, (Moving,), {}, r"pass an instance: Moving\(\)"),
    (as_policy, (Returning,), {}, r"pass an instance: Returning\(\)"),
    (simulate, (SCENARIO, Nameless()), {}, "define one in its class: name = 'mine'"),
    (as_policy, (3, SCENARIO), {}, "is not a model: expected a function of obs"),
    (as_policy, (no_such, "mine"), {}, "name='mine'"),
    (
        as_policy,
        (no_such, SCENARIO),
        {"parameters": [1.0]},
        r"parameters are for a casadi\.Function",
    ),
    (as_policy, (no_such, SCENARIO), {"dtype": "int8"}, "allowed: float32 or float64"),
    *((observed, (x,), {}, "allowed: float32 or float64") for x in ("int32", "odd", "float16")),
    (parametric, (steering, [[1.0]]), {}, r"shape \(1, 1\); expected \(p,\)"),
    (parametric, (steering, []), {}, r"shape \(0,\)"),
    (parametric, (steering, [np.nan]), {}, "NaN or infinity"),
    (parametric, (steering, "many"), {}, "expected a vector of numbers"),
    (parametric, (3, [1.0]), {}, "not a function of"),
    (
        parametric,
        (steering, START),
        {"framework": "numpy"},
        "framework = 'numpy'; allowed: casadi, jax, torch",
    ),
]


@pytest.mark.parametrize(("call", "arguments", "options", "words"), REFUSED)
def test_policy_is_refused(call, arguments, options, words):
    with pytest.raises(PolicyError, match=words):
        call(*arguments, **options)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (partial(made, "leader", solver="ipop"), SolverError, "did you mean 'ipopt'"),
        (
            partial(make_policy, SCENARIO, SCENARIO),
            TypeError,
            "a policy and a Scenario",
        ),
        (partial(make_policy, "leader", "paper-1"), TypeError, r"load_scenario\('paper-1'\)"),
        (partial(make_policy, SCENARIO, None), TypeError, "not Scenario and NoneType"),
        (partial(as_policy, no_such, 3), TypeError, r"as_policy\(\) needs a Scenario"),
        *(
            (
                partial(as_policy, leaving, time_limit=limit),
                ValueError,
                f"time_limit = {limit!r}; allowed: seconds",
            )
            for limit in (0.0, -1.0, np.nan)
        ),
        (
            partial(parametric, no_such, [1.0]),
            PolicyCallError,
            "failed at step 0 .*IndexError: no such",
        ),
        (
            partial(parametric, lambda *state: state[1].T, [1.0]),
            PolicyCallError,
            r"shape \(2, 3\) at step 0; expected \(3, 2\)",
        ),
    ],
)
def test_policy_is_refused_with_error_of_its_class(call, error, words):
    with pytest.raises(error, match=words):
        call()


# --- decisions that fail


def filled(value):
    velocities = STILL.copy()
    velocities[:, 1, 0] = value
    return velocities


def model(function):
    return as_policy(function, SCENARIO, name="model")


NONE = np.zeros(3, int)
WRONG = [
    (STILL[0], r"shape \(3, 2\) at step 4; expected \(3, 3, 2\)"),
    (STILL[0, 0], r"shape \(2,\) at step 4"),
    (np.repeat(STILL, 2, axis=1), r"shape \(3, 6, 2\) at step 4"),
    (filled(np.nan), r"velocity \[nan .* for member 1 at step 4"),
    (STILL + np.inf, r"velocity \[inf inf\] for member \d at step 4"),
]
FAILING = [
    (as_policy(singular), r"LinAlgError: Singular matrix \(.*test_policy_errors\.py"),
    (as_policy(leaving), r"failed at step 4: SystemExit: sys\.exit\(0\)"),
    (Returning(OSError("no map")), "'returning' failed at step 4: OSError: no map"),
    (Returning(STILL), "'returning' returned an object of type ndarray at step 4; decide_batch"),
    (Returning(), "returned None at step 4; decide_batch must return a Decision"),
    (
        Returning(Decision(STILL, np.zeros(2, int), NONE, NONE)),
        r"returned infeasible of shape \(2,\) at step 4; expected \(3,\)",
    ),
    (Returning(Decision(STILL, NONE, None, NONE)), r"returned failures of shape \(\) at step 4"),
    *(
        (as_policy(lambda *_, v=value: v, name="odd"), "'odd' returned an object of type .* step 4")
        for value in ("fast", [[1.0], [1.0, 2.0]], object())
    ),
    *((as_policy(lambda *_, v=v: v, name="wrong"), "'wrong' .*" + words) for v, words in WRONG),
    *((Returning(Decision.plain(v)), "'returning' .*" + words) for v, words in WRONG),
    (UserPolicy(lambda *_: STILL[0], "short"), r"'short' .* \(3, 2\) at step 4; .* \(3, 3, 2\)"),
    (model(lambda o: o[0]), r"velocities of shape \(3, 18\) at step 4; expected \(3, 3, 2\)"),
    (model(lambda o: np.full((*o.shape[:2], 2), np.nan)), "velocities must be finite"),
    (model(lambda _: None), r"velocities of shape \(\) at step 4"),
    (model(lambda o: o @ np.ones((3, 2))), "failed at step 4: ValueError"),
    (parametric(lambda *state: state[1] / 0, [1.0]), "velocities must be finite"),
]


@pytest.mark.parametrize(("policy", "words"), FAILING)
def test_failing_policy_is_named_with_step(policy, words):
    with pytest.raises(PolicyCallError, match=words) as caught:
        policy.decide(4, *STATES)
    assert (caught.value.policy, caught.value.step) == (policy.name, 4)


def test_exception_in_simulated_policy_is_named_with_step_and_users_line():
    line = dividing.__code__.co_firstlineno + 1
    words = r"policy 'dividing' failed at step 2: ZeroDivisionError: .*test_policy_errors.py:"
    with pytest.raises(PolicyCallError, match=f"{words}{line}") as caught:
        simulate(SCENARIO, dividing, runs=3)
    assert isinstance(caught.value, PolicyError)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert (caught.value.policy, caught.value.step) == ("dividing", 2)


# --- states that are not decided


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_living_members_have_finite_states(value):
    policy, odd = as_policy(Moving()), filled(value)
    for state in ((odd, STILL), (STILL, odd)):
        with pytest.raises(PolicyError, match="living members are not finite at step 4"):
            policy.decide(4, *state, STATES[2])


def test_state_of_wrong_shape_raises_policy_error_with_shapes():
    with pytest.raises(PolicyError, match=r"expected \(n, 2\), \(n, 2\), \(n,\)") as caught:
        as_policy(Moving()).decide(4, *STATES[:2], STATES[2][0])
    assert (caught.value.policy, caught.value.step) == ("Moving", 4)
    assert caught.value.shapes == [(3, 3, 2), (3, 3, 2), (3,)]


def test_state_of_another_swarm_raises_policy_error():
    one = [part[0, :1] for part in STATES]
    with pytest.raises(PolicyError, match="is for 3 members, not 1"):
        parametric(steering, START).velocities(0, *one)
    with pytest.raises(PolicyError, match="for 2 members, the swarm has 3"):
        policy("optimal").decide(0, *STATES)


# --- policies that take too long


def test_slow_policy_is_interrupted_at_its_time_limit():
    policy, started = as_policy(endless, time_limit=0.2), time.monotonic()
    with pytest.raises(PolicyCallError, match=r"took longer .* 0\.2 s at step 0") as caught:
        simulate(SCENARIO, policy, runs=3)
    assert time.monotonic() - started < 60
    assert (caught.value.policy, caught.value.step, caught.value.time_limit) == ("endless", 0, 0.2)


def test_slow_policy_in_thread_fails_when_it_ends():
    def slow(*_):
        time.sleep(0.3)
        return STILL

    policy = as_policy(slow, time_limit=0.1)
    caught = []

    def decide():
        try:
            policy.decide(5, *STATES)
        except Exception as error:
            caught.append(error)

    thread = threading.Thread(target=decide)
    thread.start()
    thread.join(60)
    assert isinstance(caught[0], PolicyCallError)
    assert "at step 5" in str(caught[0])


def test_policy_within_its_time_limit_decides_as_without():
    policy = as_policy(Moving(), name="still", time_limit=60)
    assert policy.name == "still"
    assert not policy.velocities(0, *STATES).any()
    assert (policy.leaders(0, *STATES) == -1).all()
    by_model = as_policy(lambda o: 0 * o[..., :2], SCENARIO, name="model", time_limit=60)
    assert by_model.velocities(0, *STATES).shape == (3, 3, 2)


@pytest.mark.parametrize("step", [-1, 1.5, "2", None, True])
def test_step_that_is_no_whole_number_from_0_is_refused(step):
    state = np.zeros((4, 2)), np.zeros((4, 2)), np.ones(4, bool)
    for name in ("naive", "leader", "leader-feedback"):
        with pytest.raises(csw.PolicyError, match="allowed: whole numbers from 0") as caught:
            policy(name).decide(step, *state)
        assert (caught.value.key, caught.value.value) == ("step", step)


def test_naive_policy_with_other_members_is_refused():
    with pytest.raises(csw.PolicyError, match="separate guides is for 4 members, the swarm has 3"):
        policy("naive").decide(0, np.zeros((3, 2)), np.zeros((3, 2)), np.ones(3, bool))


def test_step_is_taken_from_an_array_without_axes() -> None:
    scenario = csw.load_scenario("paper-1")
    policy = csw.make_policy("leader", scenario, csw.plan(scenario))
    state = np.full((scenario.n, 2), 0.5) + 0.1 * np.arange(scenario.n)[:, None]
    calls = [
        policy.velocities(step, state, 0 * state, np.ones(scenario.n, bool))
        for step in (3, np.array(3))
    ]
    assert calls[0].tolist() == calls[1].tolist()

"""Policies of users that fail, decide nonsense or take too long: an error with policy and step."""

from __future__ import annotations

import re
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest
from small_scenarios import small

from casswarm import Decision, Policy, PolicyError, as_policy, simulate
from casswarm.errors import PolicyCallError

SCENARIO = small([(0.0, 0.0), (0.0, 1.0)], (3.0, 0.0), [(1.5, 3.0)], 8)
STATES = np.zeros((3, 2, 2)), np.zeros((3, 2, 2)), np.ones((3, 2), bool)


def dividing(step: int, positions: Any, *_: Any) -> Any:
    return positions * (1 // (step - 2))


def leaving(*_: Any) -> Any:
    sys.exit(0)


def endless(*_: Any) -> Any:
    while True:
        try:
            time.sleep(0.01)
        except Exception:
            continue


class Returning(Policy):
    """A policy that decides what it is made with."""

    name = "returning"

    def __init__(self, decision: Any) -> None:
        self.decision = decision

    def decide_batch(self, *_: Any) -> Decision:
        return self.decision  # type: ignore[no-any-return]


def test_exception_in_policy_is_named_with_step_and_users_line() -> None:
    line = dividing.__code__.co_firstlineno + 1
    words = r"policy 'dividing' failed at step 2: ZeroDivisionError: .*test_failing_policies.py:"
    with pytest.raises(PolicyCallError, match=f"{words}{line}") as caught:
        simulate(SCENARIO, dividing, runs=3)
    assert isinstance(caught.value, PolicyError)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert (caught.value.policy, caught.value.step) == ("dividing", 2)


def test_line_of_policy_is_named_when_library_raises() -> None:
    def singular(*_: Any) -> Any:
        return np.linalg.inv(np.zeros((2, 2)))

    with pytest.raises(PolicyError, match=r"LinAlgError: Singular matrix \(.*test_failing_pol"):
        as_policy(singular).decide(0, *STATES)


def test_exit_in_policy_is_error() -> None:
    with pytest.raises(PolicyError, match=r"failed at step 0: SystemExit: sys\.exit\(0\)"):
        simulate(SCENARIO, leaving, runs=3)


def test_exception_in_subclass_is_named() -> None:
    class Broken(Policy):
        name = "broken"

        def decide_batch(self, *_: Any) -> Decision:
            raise OSError("no map")

    with pytest.raises(PolicyError, match="'broken' failed at step 4: OSError: no map"):
        Broken().decide(4, *STATES)


@pytest.mark.parametrize(
    ("decision", "words"),
    [
        (np.zeros((3, 2, 2)), "returned an object of type ndarray at step 0; decide_batch must"),
        (None, "returned None at step 0; decide_batch must return a Decision"),
        (
            Decision(np.zeros((3, 2, 2)), np.zeros(2, int), np.zeros(3, int), np.zeros(3, int)),
            r"returned infeasible of shape \(2,\) at step 0; expected \(3,\)",
        ),
        (
            Decision(np.zeros((3, 2, 2)), np.zeros(3, int), None, np.zeros(3, int)),  # type: ignore
            r"returned failures of shape \(\) at step 0",
        ),
    ],
)
def test_decision_that_is_none_raises_policy_error(decision: Any, words: str) -> None:
    with pytest.raises(PolicyCallError, match=f"'returning' {words}"):
        Returning(decision).decide(0, *STATES)


@pytest.mark.parametrize("value", ["fast", [[1.0], [1.0, 2.0]], object()])
def test_velocities_that_are_no_numbers_raise_policy_error(value: Any) -> None:
    with pytest.raises(PolicyCallError, match=r"'odd' returned an object of type .* at step 0"):
        as_policy(lambda *_: value, name="odd").decide(0, *STATES)


def test_slow_policy_is_interrupted_at_its_time_limit() -> None:
    policy, started = as_policy(endless, time_limit=0.2), time.monotonic()
    with pytest.raises(PolicyCallError, match=r"took longer .* 0\.2 s at step 0") as caught:
        simulate(SCENARIO, policy, runs=3)
    assert time.monotonic() - started < 60
    assert (caught.value.policy, caught.value.step, caught.value.time_limit) == ("endless", 0, 0.2)


def test_slow_policy_in_thread_fails_when_it_ends() -> None:
    def slow(*_: Any) -> Any:
        time.sleep(0.3)
        return np.zeros((3, 2, 2))

    policy = as_policy(slow, time_limit=0.1)
    caught: list[Exception] = []

    def decide() -> None:
        try:
            policy.decide(5, *STATES)
        except Exception as error:
            caught.append(error)

    thread = threading.Thread(target=decide)
    thread.start()
    thread.join(60)
    assert isinstance(caught[0], PolicyCallError)
    assert "at step 5" in str(caught[0])


def test_policy_within_its_time_limit_decides_as_without() -> None:
    def still(*_: Any) -> Any:
        return np.zeros((3, 2, 2))

    policy = as_policy(still, time_limit=60)
    assert policy.name == "still"
    assert not policy.velocities(0, *STATES).any()
    assert (policy.leaders(0, *STATES) == -1).all()


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_time_limit_out_of_range_is_rejected(limit: float) -> None:
    with pytest.raises(ValueError, match=re.escape(f"time_limit = {limit!r}; allowed: seconds")):
        as_policy(leaving, time_limit=limit)

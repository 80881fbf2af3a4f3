"""Simulated chain: against enumeration by hand and the guide's survival; its invariants."""

from __future__ import annotations

import math
from collections import defaultdict
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest
from brute_force import Outcome, law_by_hand, success_of
from numpy.typing import NDArray
from scipy.stats import binomtest
from small_scenarios import DT, Array, rate_by_hand, small

from casswarm import Guide, Scenario, Study, plan, simulate
from casswarm.chain import RunTrajectory, uniforms

Flags = NDArray[np.bool_]

RADARS = [(0.9, 0.8), (1.5, -1.0)]
TARGET, RADIUS, STEPS = (2.15, 0.0), 0.5, 4


@cache
def pair() -> Scenario:
    """Two members, one behind the other, four steps."""
    return small([(0.0, 0.0), (-0.5, 0.1)], TARGET, RADARS, STEPS, swarm__velocity=[1.5, 0.0])


def hurry_alone(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    """Slow and in line while both live; fast and to the south when only one does."""
    alone = alive.sum(axis=1) == 1
    together = np.array([[1.4, 0.0], [1.5, 0.1]])
    return np.where(alone[:, None, None], [1.9, -0.2], together)


@cache
def idle_guide() -> Guide:
    """Guide for policies that do not use one."""
    return plan(small([(0.0, 0.0)], (1.0, 0.0), [(9.0, 9.0)], 3, guide__search="local"))


def study(scenario: Scenario, *policies: object, **options: Any) -> Study:
    return simulate(
        scenario, policies, **{"runs": 500, "seed": 7, "guide": idle_guide(), **options}
    )


def outcomes(runs: pd.DataFrame) -> list[Outcome]:
    arrival = runs["arrival_step"].fillna(-1).astype(int)
    return list(zip(arrival, runs["survivors"], strict=True))


def assert_likely(successes: int, runs: int, probability: float) -> None:
    interval = binomtest(successes, runs).proportion_ci(0.999, method="exact")
    assert interval.low <= probability <= interval.high


# --- known answers


def test_two_member_chain_matches_enumeration_by_hand() -> None:
    distribution = law_by_hand(
        pair(),
        np.tile([1.5, 0.0], (2, 1)),
        lambda step, *state: state[0] + DT * hurry_alone(step, *(x[None] for x in state))[0],
        lambda x, alive: np.array([rate_by_hand(i, x, alive, RADARS) for i in (0, 1)]),
    )
    assert sum(distribution.values()) == pytest.approx(1, abs=1e-12)
    assert {arrival for arrival, _ in distribution} == {-1, 3, 4}
    sampled = outcomes(study(pair(), hurry_alone, runs=20_000, seed=0).runs)
    assert set(sampled) <= set(distribution)
    for outcome, probability in distribution.items():
        assert_likely(sampled.count(outcome), 20_000, probability)
    success = success_of(distribution)
    assert 0.15 < success < 0.85
    assert_likely(sum(arrival > 0 for arrival, _ in sampled), 20_000, success)
    for survivors in range(3):
        exact = sum(probability for (_, k), probability in distribution.items() if k == survivors)
        assert_likely(sum(k == survivors for _, k in sampled), 20_000, exact)


def test_member_survives_if_draw_is_below_survival_probability() -> None:
    """The rate at X(t+1), with those alive at t: a survivor has that of an isolated agent."""
    draws = np.stack([uniforms(7, t, 0, 500, 2) for t in range(STEPS)], axis=1)
    found = study(pair(), hurry_alone, save_trajectories=500)
    deaths, alone, hazard = 0, 0, pair().hazard
    for run, trace in enumerate(found.trajectories["hurry_alone"]):
        step = trace.positions[1] - trace.positions[0]
        np.testing.assert_allclose(step, [[DT * 1.4, 0.0], [DT * 1.5, DT * 0.1]], atol=1e-15)
        for t, i in zip(*np.nonzero(trace.alive[:-1]), strict=True):
            before, moved = trace.alive[t], trace.positions[t + 1]
            rate = rate_by_hand(i, moved, before, RADARS)
            assert trace.alive[t + 1, i] == (draws[run, t, i] < math.exp(-DT * rate))
            deaths += not trace.alive[t + 1, i]
            if before.sum() == 1:
                assert rate == pytest.approx(float(hazard.single_agent_rates(moved[i])), rel=1e-12)
                alone += 1
    assert deaths > 100
    assert alone > 50
    assert found.runs["saturated"].sum() == 0  # velocities within limits are unchanged


SLACKLESS = [pytest.param(*v, marks=pytest.mark.slow) for v in ((20, 0.05), (12, 0.02), (20, 0.01))]


@pytest.mark.parametrize(("steps", "a_max"), [(12, 0.5), *SLACKLESS])
def test_single_member_survival_equals_guide_survival(steps: int, a_max: float) -> None:
    """Also where the limits leave no slack to correct rounding errors."""
    scenario = small([(0.0, 0.0)], (4.0, 0.5), [(2.0, 0.3)], steps, swarm__a_max=a_max)
    guide = plan(scenario)
    found = simulate(scenario, ["leader"], runs=4000, seed=1, guide=guide, save_trajectories=100)
    whole = next(t for t in found.trajectories["leader"] if t.alive.all())
    np.testing.assert_allclose(whole.positions[:, 0], guide.positions, rtol=0, atol=1e-12)
    rates = scenario.hazard.rates(whole.positions[1:])[:, 0]
    survival = math.prod(math.exp(-DT * rate) for rate in rates)
    assert survival == pytest.approx(guide.survival, rel=1e-12)
    arrivals = found.runs["arrival_step"].dropna()
    assert (arrivals == guide.arrival).all()
    assert_likely(len(arrivals), 4000, guide.survival)
    assert found.summary["infeasible"][0] == found.summary["saturated"][0] == 0


def test_runs_in_equal_states_share_decision() -> None:
    alone = small([(0.0, 0.0)], TARGET, RADARS, STEPS, swarm__velocity=[1.5, 0.0])
    asked: list[int] = []

    def along(*state: Array) -> Array:
        asked.append(len(state[1]))
        return np.full_like(state[1], [1.5, 0.0])

    found = study(alone, along)
    steps = int(found.runs["steps"].max())
    assert asked == [1] * (2 * steps)  # a user's policy is asked twice
    assert found.effort["states"].tolist() == [steps]
    found = study(pair(), hurry_alone)
    assert found.effort["states"][0] <= 1 + 3 + 3 * 3 + 3 * 3 * 3


# --- destroyed members


@cache
def traces() -> tuple[RunTrajectory, ...]:
    scenario = small(
        [(0.0, 0.0), (-0.5, 0.1), (-0.2, -0.4)], TARGET, RADARS, 6, swarm__velocity=[0.8, 0.0]
    )
    return study(scenario, wander, save_trajectories=500).trajectories["wander"]


def wander(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:
    assert (positions[~alive] == 0).all()
    assert (previous_velocities[~alive] == 0).all()
    return np.full_like(positions, [0.8, 0.1 * step - 0.2])


def test_destroyed_members_never_return_or_move() -> None:
    destroyed = 0
    for trace in traces():
        assert (trace.alive[1:] <= trace.alive[:-1]).all()
        fallen = ~trace.alive[:-1]
        assert (trace.positions[1:][fallen] == trace.positions[:-1][fallen]).all()
        # in the step of its destruction a member still moves
        falls = trace.alive[:-1] & ~trace.alive[1:]
        assert (trace.positions[1:][falls] != trace.positions[:-1][falls]).any(axis=1).all()
        destroyed += int(falls.sum())
    assert destroyed > 200


# --- end of runs


def test_run_ends_at_arrival_destruction_or_horizon() -> None:
    found = study(pair(), hurry_alone, save_trajectories=500)
    ends = defaultdict(int)
    for row, trace in zip(found.runs.itertuples(), found.trajectories["hurry_alone"], strict=True):
        assert len(trace.positions) == len(trace.alive) == row.steps + 1
        assert trace.alive[-1].sum() == row.survivors
        inside = np.linalg.norm(trace.positions - TARGET, axis=-1) <= RADIUS
        arrived = (inside & trace.alive).any(axis=1)
        assert not arrived[:-1].any()
        assert trace.alive[:-1].any(axis=1).all()
        assert row.success == arrived[-1]
        if row.success:
            assert row.arrival_step == row.steps
            ends["arrival"] += 1
        elif row.survivors == 0:
            ends["destruction"] += 1
        else:
            assert row.steps == STEPS
            ends["horizon"] += 1
    assert ends["arrival"] > 100
    assert ends["destruction"] > 100
    crawl = study(pair(), lambda *state: 0.9 * state[2], runs=100).runs
    assert set(crawl.loc[crawl["survivors"] > 0, "steps"]) == {STEPS}


# --- limits


def overdrive(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    return np.full_like(positions, [100.0, -100.0])


def test_velocities_beyond_limits_are_saturated_and_counted() -> None:
    found = study(pair(), overdrive, save_trajectories=300, runs=300)
    saturated = 0
    for trace in found.trajectories["overdrive"]:
        velocities = np.diff(trace.positions, axis=0) / DT
        before = np.concatenate([[[[1.5, 0.0]] * 2], velocities[:-1]])
        living = trace.alive[:-1]
        assert np.abs(velocities[living]).max() <= 2.0 + 1e-12
        changes = np.linalg.norm(velocities - before, axis=-1)[living]
        np.testing.assert_allclose(changes[:1], math.sqrt(0.5), rtol=1e-9)
        assert changes.max() <= math.sqrt(0.5) + 1e-9
        saturated += int(living.sum())
    assert found.runs["saturated"].sum() == saturated
    # the nearest to the far south-east: half of a_max to each side
    first = np.diff(found.trajectories["overdrive"][0].positions[:2], axis=0)
    np.testing.assert_allclose(first / DT, [[[2.0, -0.5]] * 2], atol=5e-3)


# --- common random numbers


def test_identical_policies_give_identical_runs() -> None:
    def copied(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:
        return hurry_alone(step, positions, previous_velocities, alive)

    runs = study(pair(), hurry_alone, copied).runs.drop(columns="policy")
    pd.testing.assert_frame_equal(runs[:500], runs[500:].reset_index(drop=True))

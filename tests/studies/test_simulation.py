"""Studies: reproducible tables, independent of workers, batches and order."""

from __future__ import annotations

import math
import pickle
import warnings
from dataclasses import replace
from functools import cache, partial
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from small_scenarios import DT, Array, three_members

import casswarm.studies.simulation
from casswarm import Guide, Scenario, Study, evaluate, plan, runs_needed, simulate
from casswarm.chain import required_runs, wilson
from casswarm.errors import CasswarmWarning
from casswarm.studies.tables import end_notes, summarise

Flags = NDArray[np.bool_]
SUMMARY = {"policy", "runs", "successes", "success", "success_low", "success_high"} | {
    "survivors_mean",
    "arrival_step_mean",
    "infeasible",
    "solver_failures",
}
RUNS = {"policy", "run", "success", "survivors", "arrival_step"}


@cache
def scenario() -> Scenario:
    return three_members(guide__search="local", guide__a_max=0.3)


@cache
def guide() -> Guide:
    return plan(scenario())


def straight_on(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    """Everybody to the target, as fast as the limits allow."""
    return np.clip((np.array([3.0, 0.0]) - positions) / DT, -2.0, 2.0)


def stay(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    """Nobody ever arrives."""
    return 0.9 * previous_velocities


POLICIES = ("leader", straight_on)


def study(policies: Any = POLICIES, runs: int = 300, **options: Any) -> Study:
    return simulate(scenario(), policies, runs=runs, **({"seed": 4, "guide": guide()} | options))


@cache
def reference() -> Study:
    return study()


def assert_same_tables(found: Study, expected: Study) -> None:
    pd.testing.assert_frame_equal(found.runs, expected.runs, check_exact=True)
    pd.testing.assert_frame_equal(found.summary, expected.summary, check_exact=True)


def of(table: pd.DataFrame, policy: str) -> pd.DataFrame:
    return table[table["policy"] == policy].reset_index(drop=True)


# --- same seed, same numbers


def test_simulate_same_seed_gives_same_tables() -> None:
    assert_same_tables(study(), reference())
    assert not study(seed=5).runs.equals(reference().runs)


@pytest.mark.slow
def test_simulate_tables_are_independent_of_workers() -> None:
    found = study(workers=2, save_trajectories=160)  # more than the first worker's share
    assert_same_tables(found, reference())
    alone = study(save_trajectories=160)
    for policy in ("leader", "straight_on"):
        assert len(found.trajectories[policy]) == 160
        for one, other in zip(found.trajectories[policy], alone.trajectories[policy], strict=True):
            np.testing.assert_array_equal(one.positions, other.positions)
            np.testing.assert_array_equal(one.alive, other.alive)


@pytest.mark.parametrize("batch", [1, 7, 299])
def test_simulate_tables_are_independent_of_batch_size(
    batch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = 20 if batch == 1 else 300
    expected = study(runs=runs)
    monkeypatch.setattr(casswarm.studies.simulation, "BATCH", batch)
    assert_same_tables(study(runs=runs), expected)


def test_simulate_policy_is_independent_of_other_policies() -> None:
    for policies in (POLICIES[::-1], (straight_on,), ("leader",), ("constrained", *POLICIES)):
        found = study(policies)
        for name in {"leader", "straight_on"} & set(found.runs["policy"]):
            expected = of(reference().runs, name)
            pd.testing.assert_frame_equal(of(found.runs, name), expected, check_exact=True)
            expected = of(reference().summary, name)
            pd.testing.assert_frame_equal(of(found.summary, name), expected, check_exact=True)


def test_simulate_more_runs_extend_tables() -> None:
    fewer, more = study(runs=50), study(runs=100)
    for policy in ("leader", "straight_on"):
        extended = of(more.runs, policy)
        pd.testing.assert_frame_equal(extended[:50], of(fewer.runs, policy), check_exact=True)


def test_simulate_uses_common_random_numbers() -> None:
    """A run that succeeds in more danger succeeds in less."""
    harder = scenario().with_values({"hazard.alpha_1": 5.0})
    easy = of(reference().runs, "straight_on")
    hard = simulate(harder, [straight_on], runs=300, seed=4, guide=guide()).runs
    assert easy["success"].sum() > hard["success"].sum() > 0
    # not pairwise implied, for the dead protect nobody; but nearly
    assert (hard["success"] & ~easy["success"]).mean() < 0.02


def test_runs_needed_draws_other_numbers_than_study() -> None:
    of_study = partial(simulate, scenario(), ["leader"], 200, guide=guide())
    needed = partial(runs_needed, scenario(), ["leader"], 0.01, pilot=200, guide=guide())
    successes = [int(of_study(seed=seed).summary["successes"][0]) for seed in range(5)]
    of_studies = [required_runs(0.01, number, 200) for number in successes]
    assert [needed(seed=seed) for seed in range(5)] != of_studies
    assert needed(seed=3) == needed(seed=3)


# --- tables


def test_study_tables_have_documented_columns() -> None:
    found = reference()
    assert set(found.summary.columns) >= SUMMARY
    assert set(found.runs.columns) >= RUNS
    assert found.summary["policy"].tolist() == ["leader", "straight_on"]
    assert found.runs["policy"].tolist() == ["leader"] * 300 + ["straight_on"] * 300
    assert found.runs["run"].tolist() == [*range(300)] * 2
    assert found.runs["success"].dtype == bool
    assert found.effort["policy"].tolist() == ["leader", "straight_on"]


def test_summary_aggregates_runs() -> None:
    for _, row in reference().summary.iterrows():
        runs = of(reference().runs, row["policy"])
        arrivals = [int(step) for step in runs["arrival_step"] if step is not pd.NA]
        assert len(arrivals) == row["successes"] == runs["success"].sum()
        assert 0 < len(arrivals) < row["runs"] == 300
        assert row["success"] == len(arrivals) / 300
        assert (row["success_low"], row["success_high"]) == wilson(len(arrivals), 300)
        assert row["survivors_mean"] == pytest.approx(sum(runs["survivors"]) / 300)
        assert row["arrival_step_mean"] == pytest.approx(sum(arrivals) / len(arrivals))
        for count in ("infeasible", "solver_failures", "saturated"):
            assert row[count] == sum(runs[count])
    assert reference().summary["saturated"].tolist() == [0, reference().runs["saturated"].sum()]


def test_arrival_step_is_missing_without_arrival() -> None:
    runs = reference().runs
    assert (runs["arrival_step"].isna() == ~runs["success"]).all()
    assert (runs.loc[runs["success"], "survivors"] > 0).all()


def test_summary_without_success_has_upper_bound() -> None:
    found = study([stay], runs=40).summary.iloc[0]
    assert (found["successes"], found["success"], found["success_low"]) == (0, 0.0, 0.0)
    assert 0.05 < found["success_high"] < 0.15
    assert math.isnan(found["arrival_step_mean"])


def test_summary_of_table_from_csv_is_equal(tmp_path: Any) -> None:
    reference().runs.to_csv(tmp_path / "runs.csv", index=False)
    again = summarise(pd.read_csv(tmp_path / "runs.csv"))
    pd.testing.assert_frame_equal(again, reference().summary)


def test_study_text_shows_guide_and_policies() -> None:
    lines = str(reference()).splitlines()
    assert lines[0] == str(guide())
    assert [line.split()[0] for line in lines[1:]] == ["policy", "leader", "straight_on"]


def test_study_values_by_name_have_the_rows_of_tables() -> None:
    values = reference().as_dict()
    assert list(values) == ["summary", "paired", "effort", "guide"]
    assert values["summary"] == reference().summary.to_dict("records")
    assert values["guide"]["risk"] == guide().risk


def test_study_can_be_pickled() -> None:
    assert_same_tables(pickle.loads(pickle.dumps(reference())), reference())


def test_trajectories_are_those_of_first_runs() -> None:
    assert {name: len(kept) for name, kept in study(save_trajectories=3).trajectories.items()} == {
        "leader": 3,
        "straight_on": 3,
    }
    assert {len(kept) for kept in study(runs=2, save_trajectories=5).trajectories.values()} == {2}
    assert {len(kept) for kept in study(save_trajectories=0).trajectories.values()} == {0}


# --- intervals


@given(st.integers(1, 10**6), st.floats(0, 1), st.sampled_from([0.9, 0.95, 0.999]))
def test_wilson_interval_solves_score_test(runs: int, share: float, level: float) -> None:
    """Both ends solve (p - k/n)^2 = z^2 p (1 - p) / n."""
    successes = round(share * runs)
    z = {0.9: 1.6448536269514722, 0.95: 1.959963984540054, 0.999: 3.2905267314918945}[level]
    p, share_of_z = successes / runs, z * z / runs
    center = (p + share_of_z / 2) / (1 + share_of_z)
    half = math.sqrt(p * (1 - p) * share_of_z + share_of_z**2 / 4) / (1 + share_of_z)
    low, high = wilson(successes, runs, level)
    assert low == pytest.approx(max(0.0, center - half), abs=1e-12)
    assert high == pytest.approx(min(1.0, center + half), abs=1e-12)
    assert 0 <= low <= p <= high <= 1


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (1, 20, 0.0089, 0.2361),
        (81, 263, 0.2553, 0.3662),
    ],
)
def test_wilson_interval_equals_published_values(
    successes: int, runs: int, low: float, high: float
) -> None:
    """81 of 263 is the example of Newcombe, Statistics in Medicine 17 (1998), table I."""
    assert wilson(successes, runs) == pytest.approx((low, high), abs=5e-5)


# --- progress and guides


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_simulate_progress_reaches_total_for_every_policy(workers: int) -> None:
    reports: list[tuple[str, int, int]] = []
    study(runs=30, workers=workers, progress=lambda *news: reports.append(news))
    assert {total for _, _, total in reports} == {30}
    for policy in ("leader", "straight_on"):
        ended = [done for name, done, _ in reports if name == policy]
        assert ended == sorted(ended)
        assert ended[-1] == 30


def test_simulate_accepts_single_policy() -> None:
    assert_same_tables(study("leader", runs=20), study(["leader"], runs=20))
    assert_same_tables(study(straight_on, runs=20), study([straight_on], runs=20))


def test_study_repr_is_one_line() -> None:
    assert repr(reference()).startswith("Study(")
    assert len(repr(reference()).splitlines()) == 1


def test_simulate_plans_without_certificate_and_keeps_the_one_of_a_given_guide() -> None:
    scenario = three_members()
    planned, given = simulate(scenario, ["leader"], runs=2).guide, plan(scenario)
    assert planned.certificate is None is planned.risk_bound
    np.testing.assert_array_equal(planned.positions, given.positions)
    assert given.certificate is not None
    assert simulate(scenario, ["leader"], runs=2, guide=given).guide is given


def test_notes_count_runs_that_end_alive_outside_the_target() -> None:
    runs = simulate(scenario(), [stay, straight_on], runs=40, guide=guide()).runs
    left = runs[(runs["policy"] == "stay") & (runs["survivors"] > 0)]
    (note,) = end_notes(runs, guide(), scenario().swarm.v_max)
    assert len(left) > 0
    assert note == (
        f"stay: {len(left)} runs of 40 end at step {scenario().n_steps} with living members "
        f"outside the target, the nearest {left['distance'].min():.2g} away "
        f"({left['survivors'].mean():.1f} alive on average)"
    )


def test_distance_of_runs_is_that_of_their_nearest_living_member_from_the_target() -> None:
    found = simulate(scenario(), [stay, "leader"], 40, guide=guide(), save_trajectories=40)
    for name, trajectories in found.trajectories.items():
        rows = of(found.runs, name)
        for row, trajectory in zip(rows.to_dict("records"), trajectories, strict=True):
            living = trajectory.positions[-1][trajectory.alive[-1]]
            outside = np.hypot(*(living - scenario().target.center).T) - scenario().target.radius
            expected = max(outside.min(), 0.0) if len(living) else math.nan
            np.testing.assert_allclose(row["distance"], expected, atol=1e-12)
        assert (rows["distance"][rows["success"]] == 0).all()


@pytest.mark.parametrize(
    ("speed", "spare", "told"), [(1.0, 2, True), (1.0, 0, True), (0.9, 2, False)]
)
def test_note_says_that_a_leader_cannot_catch_up_with_a_guide_at_full_speed(
    speed: float, spare: int, told: bool
) -> None:
    steps = scenario().n_steps - spare
    fast = replace(guide(), velocities=np.full((steps, 2), speed * scenario().swarm.v_max))
    runs = simulate(scenario(), [stay], 40, guide=guide()).runs.assign(policy="leader")
    (note,) = end_notes(runs, fast, scenario().swarm.v_max)
    assert (f"cannot catch up: the guide flies at v_max in {steps} of its {steps}" in note) == told
    assert ("guide.max_wait" in note) == (told and spare > 0)


@pytest.mark.parametrize("call", [pytest.param(simulate, marks=pytest.mark.slow), evaluate])
def test_slow_rates_of_a_function_are_told_once(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("casswarm.studies.inputs.SLOW", 0.0)
    few: dict[str, Any] = {"runs": 3} if call is simulate else {"max_states": 20}
    foggy = scenario().with_hazard(lambda x, alive: 0.3 / (1 + ca.sum2(x**2)))  # noqa: ARG005
    with pytest.warns(CasswarmWarning, match=r"KernelHazard in docs/own-rates\.md") as caught:
        call(foggy, "leader", guide=guide(), **few)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        call(scenario(), "leader", guide=guide(), **few)
        call(foggy, "naive", guide=guide(), **few)


def test_generator_gives_one_seed() -> None:
    scenario = three_members()
    first, second = (np.random.default_rng(3) for _ in range(2))
    study = simulate(scenario, "naive", runs=20, seed=first)
    assert study.seed == int(second.integers(0, 2**64 - 1, dtype=np.uint64, endpoint=True))
    again = simulate(scenario, "naive", runs=20, seed=study.seed)
    pd.testing.assert_frame_equal(study.runs, again.runs)
    next_of_both = [simulate(scenario, "naive", 2, seed=each).seed for each in (first, second)]
    assert next_of_both[0] == next_of_both[1] != study.seed

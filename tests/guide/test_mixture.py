"""Mixtures of guides: known answers, invariances, a single case, and what is printed and saved."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from scaled_scenarios import scaled
from small_scenarios import small

import casswarm as csw
from casswarm.guide import MixedGuide
from casswarm.guide.mixture import _groups, certify_mixture, plan_mixture

FREE = {"guide__acceleration_limited": False, "guide__margin": 1e-6}
WALL = [[1.5, y] for y in (-2.0, -1.2, -0.4, 0.4, 1.2, 2.0)]


def gaps(weights=(1.0, 1.0), **values):
    """A wall of radars that lacks one of two, symmetric about the way."""
    cases = [
        {"radars": [r for r in WALL if r[1] != gap], "weight": weight}
        for gap, weight in zip((0.4, -0.4), weights, strict=True)
    ]
    base = small([(0.0, 0.0)], (3.0, 0.0), [(9.0, 9.0)], 8, **FREE)
    return base.with_values({"hazard.radars": None, "hazard.case": cases} | values)


@pytest.fixture(scope="module")
def worst():
    return csw.plan(gaps(), ambiguity="worst")


def test_symmetric_gaps_are_mixed_equally(worst) -> None:
    assert worst.gap < 0.01
    assert worst.value.low <= worst.value.high < 1
    np.testing.assert_allclose(worst.weights.sum(), 1.0)
    np.testing.assert_allclose(worst.survival, worst.value.low, rtol=1e-3)
    np.testing.assert_allclose(worst.worst_prior, 0.5, atol=0.01)
    assert worst.pure_value < worst.value.low < worst.known_value
    sides = [float(path.positions[:, 1].mean()) for path in worst.paths[:2]]
    assert sides[0] * sides[1] < 0
    for path, survivals in zip(worst.paths, worst.survivals, strict=True):
        assert np.hypot(*(path.positions[-1] - (3.0, 0.0))) <= 0.5
        for case, survival in zip(gaps().cases, survivals, strict=True):
            risk = 0.33 * case.scenario.rates_along(path.positions).sum()
            assert survival == pytest.approx(np.exp(-risk), rel=1e-12)


@pytest.mark.slow
def test_values_fall_from_the_mean_to_the_worst_case(worst) -> None:
    scenario = gaps(weights=(4.0, 1.0))
    chosen = ["mean", ("cvar", 0.9), ("cvar", 0.7), "worst"]
    mixed = [csw.plan(scenario, ambiguity=each) for each in chosen]
    for before, after in itertools.pairwise(mixed):
        assert after.value.low <= before.value.high * (1 + 1e-9)
    assert mixed[0].value.low > mixed[-1].value.high
    assert mixed[-1].value.low == pytest.approx(worst.value.low, rel=0.01)
    assert all(each.gap < 0.01 for each in mixed)
    best = max(mixed[0].prior @ row for row in mixed[0].survivals)
    assert mixed[0].value.low == pytest.approx(best)  # for the mean a single path is best


def image_of(scenario, image):
    """Another scenario of the same value."""
    if image == "order":
        cases = [case.model_dump(exclude_unset=True) for case in scenario.hazard_table.case]
        return scenario.with_values({"hazard.case": cases[::-1]})
    if image == "turned":
        cases = [
            {"radars": [(-y, x) for x, y in case.radars]} for case in scenario.hazard_table.case
        ]
        return scenario.with_values({"hazard.case": cases, "target.center": (0.0, 3.0)})
    factors = {"length": {"length": 1e3}, "time": {"time": 1e-3}}[image]
    parts = [scaled(case.scenario, **factors) for case in scenario.cases]
    cases = [{"radars": part.hazard_table.radars} for part in parts]
    return parts[0].with_values({"hazard.radars": None, "hazard.case": cases})


@pytest.mark.slow
@pytest.mark.parametrize("image", ["length", "time", "turned", "order"])
def test_units_images_and_order_change_nothing(image, worst) -> None:
    mixed = csw.plan(image_of(gaps(), image), ambiguity="worst")
    assert mixed.value.low == pytest.approx(worst.value.low, rel=1e-4)
    assert mixed.value.high == pytest.approx(worst.value.high, rel=0.01)


@pytest.mark.slow
def test_single_case_is_the_guide_of_a_known_hazard() -> None:
    known = small([(0.0, 0.0)], (3.0, 0.0), [(1.5, 0.4)], 8)
    same = known.with_values({"hazard.case": [{}, {"weight": 5.0}]})
    guide = csw.plan(known)
    for scenario in (known, same):
        mixed = csw.plan(scenario, ambiguity="worst")
        assert isinstance(mixed, MixedGuide)
        assert mixed.value.low == guide.survival
        assert mixed.value.high == guide.survival_bound
        np.testing.assert_array_equal(mixed.paths[0].positions, guide.positions)


@pytest.mark.slow
def test_case_of_weight_zero_changes_the_mean_by_nothing() -> None:
    scenario = gaps(weights=(1.0, 0.0))
    mixed = csw.plan(scenario, ambiguity="mean")
    alone = csw.plan(scenario.cases[0].scenario)
    assert mixed.value.low == pytest.approx(alone.survival, rel=1e-6)
    assert mixed.gap < 0.01
    worst = csw.plan(scenario, ambiguity="worst")
    assert worst.value.high < mixed.value.low


@pytest.mark.slow
def test_mixture_of_least_risk_is_between_proven_ends() -> None:
    scenario = gaps()
    mixed = csw.plan(scenario, ambiguity="worst", objective="risk", gap=0.005)
    low, high = mixed.value
    assert 0 < low <= high <= low * 1.01
    risks = -np.log(mixed.survivals)
    np.testing.assert_allclose(mixed.weights @ risks, high, rtol=1e-4)  # equal in both cases
    np.testing.assert_allclose(mixed.worst_prior, 0.5, atol=0.01)
    assert mixed.known_value <= high <= mixed.pure_value
    for path, own in zip(mixed.paths, risks, strict=True):
        rates = [case.scenario.rates_along(path.positions).sum() for case in scenario.cases]
        np.testing.assert_allclose(own, 0.33 * np.array(rates), rtol=1e-12)
    assert "risk by case" in str(mixed)
    # against the mean it is the guide of the mean rates, which nobody improves by lot
    mean = csw.plan(scenario, ambiguity="mean", objective="risk")
    guide = csw.plan(scenario, objective="risk")
    assert len(mean.paths) == 1
    assert mean.value.high == pytest.approx(guide.risk, rel=1e-6)
    assert mean.value.low <= guide.risk
    assert high >= mean.value.low
    one = csw.plan(scenario.cases[0].scenario, ambiguity="worst", objective="risk")
    assert one.value.high == one.pure_value == one.pure.risk


def test_risk_is_the_guide_of_the_mean_rates() -> None:
    scenario = gaps(weights=(3.0, 1.0))
    guide = csw.plan(scenario, objective="risk")
    risks = [case.scenario.rates_along(guide.positions).sum() for case in scenario.cases]
    assert guide.risk == pytest.approx(0.33 * (0.75 * risks[0] + 0.25 * risks[1]), rel=1e-9)
    assert guide.risk_bound <= guide.risk
    mixed = csw.plan(scenario, ambiguity="mean")
    for row in mixed.survivals:  # of Jensen: the mean survival is at least that of the mean risk
        assert mixed.prior @ row >= np.exp(mixed.prior @ np.log(row)) - 1e-12


@pytest.mark.slow
def test_limits_of_acceleration_hold_and_are_said() -> None:
    limited = gaps(**{"guide.acceleration_limited": True, "guide.a_max": 0.3})
    mixed = csw.plan(limited, ambiguity="worst")
    for path in mixed.paths:
        changes = np.diff(path.velocities, axis=0)
        assert (changes**2).sum(axis=1).max() <= 0.3
    assert mixed.note == "the bound ignores limits of acceleration"
    assert mixed.value.low < mixed.value.high


@pytest.mark.slow
def test_more_than_four_cases_are_bounded_by_groups_and_say_so() -> None:
    base = small([(0.0, 0.0)], (3.0, 0.0), [(9.0, 9.0)], 7, **FREE)
    places = [[1.5, y] for y in (-0.5, -0.25, 0.0, 0.25, 0.5)]
    scenario = base.with_values({"hazard.case": [{"radars": [place]} for place in places]})
    mixed = csw.plan(scenario, ambiguity="mean")
    assert "knows in which of these groups the case is" in mixed.note
    groups = [list(map(int, each.split("/"))) for each in mixed.note.split(": ")[1].split(" and ")]
    assert sorted(itertools.chain(*groups)) == list(range(5))
    assert max(map(len, groups)) == 4
    assert mixed.value.low <= mixed.value.high < mixed.known_value
    # a group of its own is bounded by the same number
    own = [
        0.2
        * len(group)
        * csw.plan(
            scenario.with_prior([float(k in group) for k in range(5)]), ambiguity="mean"
        ).value.low
        for group in groups
    ]
    assert sum(own) <= mixed.value.high * (1 + 1e-9)


def test_possible_case_that_no_known_path_survives_is_in_a_group() -> None:
    prior = np.array([0.4, 0.0, 0.2, 0.2, 0.1, 0.1])
    values = prior * np.array([[0.9, 0.5, 0.0, 0.3, 0.2, 0.1], [0.1, 0.5, 0.0, 0.6, 0.1, 0.3]])
    assert sorted(itertools.chain(*_groups(values, prior))) == [0, 2, 3, 4, 5]


def test_wrong_arguments_are_refused() -> None:
    scenario = gaps()
    with pytest.raises(csw.PlanningError, match="ambiguity = 'best'"):
        csw.plan(scenario, ambiguity="best")
    with pytest.raises(ValueError, match="search= is not for a mixture"):
        csw.plan(scenario, ambiguity="mean", search="local")
    with pytest.raises(ValueError, match="objective = 'speed'"):
        csw.plan(scenario, objective="speed")
    other = {"target.other": [{"center": [3.0, 2.0], "radius": 0.3}]}
    with pytest.raises(csw.ScenarioError, match=r"target\.other"):
        csw.plan(scenario.with_values(other), ambiguity="mean")


@pytest.mark.slow
def test_command_writes_the_mixture_and_draws_it_again(tmp_path) -> None:
    def casswarm(*arguments):
        command = [sys.executable, "-m", "casswarm", *arguments]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)

    done = casswarm("plan", "two-gaps", "--ambiguity", "worst", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "mixture of 2 guides for worst: survival 0.0797" in done.stdout
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["result"]["value"]["low"] == pytest.approx(0.0797, abs=1e-4)
    assert (tmp_path / "out" / "mixture.png").exists()
    drawn = casswarm("plot", "out", "--out", "drawn")
    assert drawn.returncode == 0, drawn.stderr
    assert (tmp_path / "drawn" / "mixture.png").exists()
    for arguments, message in (
        (("two-gaps",), "say with --ambiguity"),
        (("two-gaps", "--ambiguity", "cvar:7"), "no set of priors"),
        (("two-gaps", "--ambiguity", "mean", "--map"), "--map does not apply"),
        (("two-gaps", "--ambiguity", "mean", "--verbose"), "--verbose does not apply"),
    ):
        refused = casswarm("plan", *arguments)
        assert refused.returncode == 2 or refused.returncode == 1
        assert message in " ".join(refused.stderr.split())


def test_search_near_a_mixture_finds_that_of_a_similar_scenario(worst) -> None:
    walls = [[[x, y + 0.03 * x] for x, y in case.radars] for case in gaps().hazard_table.case]
    moved = gaps().with_values({"hazard.case": [{"radars": radars} for radars in walls]})
    near = plan_mixture(moved, "worst", near=worst, certify=False)
    full = plan_mixture(moved, "worst", certify=False)
    assert near.value.low == pytest.approx(full.value.low, rel=5e-3)
    assert near.value.high == 1.0
    certified = certify_mixture(moved, near)
    assert full.value.low <= certified.value.high < 1
    assert certified.value.low == near.value.low
    assert certified.gap < 0.02


@pytest.mark.slow
def test_guides_of_the_cases_are_those_of_known_hazards(worst) -> None:
    for case, guide, known in zip(gaps().cases, worst.guides, worst.known, strict=True):
        assert guide.survival <= known * (1 + 1e-9)
        assert guide.risk == pytest.approx(csw.plan(case.scenario, certify=False).risk, rel=1e-6)
    risks = csw.plan(gaps(), ambiguity="worst", objective="risk", certify=False)
    for case, guide in zip(gaps().cases, risks.guides, strict=True):
        np.testing.assert_allclose(guide.rates, case.scenario.rates_along(guide.positions))

"""Scenarios whose hazard is not known: cases, their weights, means, files and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenarios import abreast, colliding

import casswarm as csw
from casswarm.errors import ScenarioError
from casswarm.hazard import MeanHazard

BASE = abreast(2)
LEFT, RIGHT = {"radars": [[1.0, 0.9]], "weight": 3.0}, {"radars": [[1.0, -0.9], [2.0, 1.0]]}
TWO = BASE.with_values({"hazard.radars": None, "hazard.case": [LEFT, RIGHT]})


def test_cases_inherit_keys_and_have_normalised_weights() -> None:
    first, second = TWO.cases
    assert (first.weight, second.weight) == (0.75, 0.25)
    assert first.scenario == BASE.with_values({"hazard.radars": [[1.0, 0.9]]})
    assert second.scenario.hazard.radar_positions.tolist() == RIGHT["radars"]
    assert BASE.cases == ((1.0, BASE),)


def test_equal_cases_are_one() -> None:
    same = BASE.with_values({"hazard.case": [{}, {"weight": 2.0}]})
    (only,) = same.cases
    assert only == (1.0, BASE)
    assert same.hazard == BASE.hazard
    three = TWO.with_values({"hazard.case": [LEFT, RIGHT, LEFT | {"weight": 1.0}]})
    assert [case.weight for case in three.cases] == [0.8, 0.2]


def test_file_round_trips(tmp_path) -> None:
    text = TWO.to_toml()
    assert text.count("[[hazard.case]]") == 2
    path = tmp_path / "two.toml"
    path.write_text(text, encoding="utf-8")
    assert csw.load_scenario(path) == TWO
    assert csw.load_scenario("cloud").to_toml(comments=True).count("[[hazard.case]]") == 9


def test_mean_rates_are_the_weighted_means() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 4, (50, 2))
    weights = np.array([0.3, 0.7])
    strong = RIGHT | {"strengths": [2.0, 0.5], "alpha_1": 7.0}
    two = TWO.with_values({"hazard.case": [LEFT, strong]})
    mean = two.of_mean_rates(weights).hazard.single_agent_rates(points)
    rates = [case.scenario.hazard.single_agent_rates(points) for case in two.cases]
    np.testing.assert_allclose(mean, weights @ rates, rtol=1e-12)
    alone = two.of_mean_rates([0.0, 1.0])
    assert alone.hazard == two.cases[1].scenario.hazard


def test_mean_of_other_kinds_is_computed() -> None:
    rng, weights = np.random.default_rng(1), np.array([0.3, 0.7])
    other = TWO.with_values({"hazard.case": [LEFT, RIGHT | {"alpha_3": 2.0}]})
    mean = other.of_mean_rates(weights)
    assert isinstance(mean.hazard, MeanHazard)
    states, alive = rng.uniform(-1, 4, (20, 2, 2)), rng.random((20, 2)) < 0.7
    each = [case.scenario.hazard for case in other.cases]
    expected = sum(w * h.rates(states, alive) for w, h in zip(weights, each, strict=True))
    np.testing.assert_allclose(mean.hazard.rates(states, alive), expected, rtol=1e-13)
    points = states[:, 0]
    single = sum(w * h.single_agent_rates(points) for w, h in zip(weights, each, strict=True))
    np.testing.assert_allclose(mean.hazard.single_agent_rates(points), single, rtol=1e-13)
    low = mean.hazard.single_agent_lower_bound(points - 0.2, points + 0.2)
    assert low is not None
    assert (low <= single).all()
    guide = csw.plan(mean)
    assert guide.risk_bound is not None
    assert 0.9 * guide.risk < guide.risk_bound <= guide.risk
    # the same field, once as a mean of hazards and once as one with the radars of both
    plain = TWO.of_mean_rates(weights).hazard
    tables = [case.scenario.hazard for case in TWO.cases]
    computed = MeanHazard(tuple(tables), tuple(weights))
    np.testing.assert_allclose(computed.rates(states, alive), plain.rates(states, alive))


@pytest.mark.parametrize(
    ("cases", "message"),
    [
        ([LEFT], "a single table, so nothing is unknown"),
        ([LEFT] * 101, r"must be 2 to 100 tables \[\[hazard.case\]\]"),
        ([LEFT | {"weight": -1.0}, RIGHT], r"hazard\.case\[0\]\.weight is -1"),
        ([LEFT | {"weight": 0.0}, RIGHT | {"weight": 0.0}], "weights that are all 0"),
        ([{"radars": [[0.0, 0.0]]}, RIGHT], r"on hazard\.case\[0\]\.radars\[0\]"),
        ([LEFT, RIGHT | {"strengths": [1.0]}], r"hazard\.case\[1\]\.strengths has 1 number for 2"),
        ([LEFT, {"radar": 3}], r"hazard\.case\[1\]\.radar is 3"),
        ([LEFT, {"colour": "red"}], r"unknown key 'hazard\.case\[1\]\.colour'"),
        ([LEFT, {"kind": "other"}], r"hazard\.kind is 'other'"),
    ],
)
def test_wrong_cases_are_refused(cases, message) -> None:
    with pytest.raises(ScenarioError, match=message):
        TWO.with_values({"hazard.case": cases})


@pytest.mark.parametrize(
    "use",
    [
        csw.plan,
        csw.optimal_value,
        csw.ValueFunction.from_scenario,
        csw.guide_problems,
    ],
)
def test_parts_for_a_known_hazard_refuse_it_by_name(use) -> None:
    with pytest.raises(csw.CasswarmError, match=r"2 cases of its\s+hazard \(hazard\.case\)"):
        use(TWO)


def test_only_case_has_the_numbers_of_a_known_hazard() -> None:
    same = BASE.with_values({"hazard.case": [{}, {}]})
    ours, theirs = (csw.evaluate(each, "leader", 0.0) for each in (same, BASE))
    assert ours.success == theirs.success
    assert csw.plan(same).survival_bound == csw.plan(BASE).survival_bound


def test_zero_weight_is_a_case_that_is_possible_only() -> None:
    possible = TWO.with_values({"hazard.case": [LEFT, RIGHT | {"weight": 0.0}]})
    assert [case.weight for case in possible.cases] == [1.0, 0.0]
    assert colliding(possible).cases[1].scenario.hazard_table.beta_1 == 0.2


def test_other_prior_keeps_the_cases_that_are_possible() -> None:
    other = TWO.with_prior([1.0, 3.0])
    assert [case.weight for case in other.cases] == [0.25, 0.75]
    assert [case.scenario for case in other.cases] == [case.scenario for case in TWO.cases]
    assert TWO.with_prior([0.0, 1.0]) == TWO.cases[1].scenario
    assert BASE.with_prior([0.3]) is BASE
    three = TWO.with_values({"hazard.case": [LEFT, RIGHT, LEFT]}).with_prior([0.5, 0.5])
    assert [case.weight for case in three.cases] == [0.5, 0.5]


def test_believed_rates_are_those_of_the_prior() -> None:
    assert BASE.believed is BASE
    assert TWO.believed.hazard == TWO.of_mean_rates([0.75, 0.25]).hazard

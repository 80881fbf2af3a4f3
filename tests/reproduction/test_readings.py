"""Table II under other readings of the paper, and after small changes of the geometry."""

import pytest
from reproduced import checked_in

import casswarm as csw
from casswarm.reproduction.paper_tables import (
    READINGS,
    Reading,
    geometry_changes,
    guide_changes,
    readings,
    sensitivity,
)
from casswarm.studies import PAPER_POLICIES

FIRST = csw.load_scenario("paper-1")


def silent(_):
    """No progress."""


def test_readings_begin_with_the_method_itself():
    """The first row is the paper's method as casswarm reads it; the others change one thing."""
    quick = FIRST.with_values({"guide.iterations": 300, "formation.iterations": 20})
    of_formations = [each for each in READINGS if each.question in ("first iterate", "V(-1)")]
    table = readings(quick, silent, runs=20, chosen=[*READINGS[:2], *of_formations])
    method = csw.simulate(quick, PAPER_POLICIES, 20, solver="projected-gradient").summary
    assert table.loc[0, ["naive", "constrained", "leader"]].tolist() == method["success"].tolist()
    assert table.loc[0, "guide_survival"] > table.loc[1, "guide_survival"]
    assert (table.loc[[0, 2, 3], "guide_survival"] == table.loc[0, "guide_survival"]).all()
    assert table["within"].between(0, 3).all()


def test_reading_whose_guide_does_not_arrive_has_no_success():
    tiny = {"guide.gamma": 1e-9, "guide.learning_rate": 5000.0}
    far = Reading("III.A", "gamma", "tiny", tiny)
    row = readings(FIRST, silent, runs=2, chosen=[far]).loc[0]
    assert row["guide_survival"] == row["within"] == 0
    assert "leader" not in row


def test_saved_sensitivity_by_the_papers_method_is_in_its_intervals():
    table = checked_in("sensitivity")
    assert (table.loc[table["solver"] == "projected-gradient", "within"] == 3).all()


@pytest.mark.slow
def test_sensitivity_equals_saved_table():
    saved, made = checked_in("sensitivity"), sensitivity(FIRST, silent, runs=100)
    assert made[["solver", "change"]].equals(saved[["solver", "change"]])
    for (_, old), (_, new) in zip(saved.iterrows(), made.iterrows(), strict=True):
        assert new["guide_survival"] == pytest.approx(old["guide_survival"], abs=2e-4)
        for policy in PAPER_POLICIES:  # intervals of the same number
            assert new[f"{policy}_low"] <= old[f"{policy}_high"] + 0.01, tuple(new)[:2]
            assert old[f"{policy}_low"] <= new[f"{policy}_high"] + 0.01, tuple(new)[:2]


def test_changes_keep_scenario_valid_and_differ():
    for _, change in [*geometry_changes(FIRST), *guide_changes(FIRST)]:
        assert FIRST.with_values(change) != FIRST

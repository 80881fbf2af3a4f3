"""Problems of one's own scenario, and files of problems in a comparison."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest

import casswarm as csw
from casswarm.comparison import make_problems, make_report
from casswarm.comparison.report import _families

X = ca.SX.sym("x", 2)


@pytest.fixture(scope="module")
def scenario() -> csw.Scenario:
    return csw.load_scenario("wall").with_values({"guide.arrival": "horizon"})


@pytest.fixture(scope="module")
def formations(scenario: csw.Scenario) -> list[csw.Problem]:
    return csw.formation_problems(scenario, ["leader", "constrained"], 2, runs=5)


def test_formation_problems_are_of_policies_and_seeded(scenario, formations) -> None:
    assert [p.name for p in formations[::2]] == ["wall leader 0", "wall constrained 0"]
    assert {p.family for p in formations} == {"wall formations"}
    again = csw.formation_problems(scenario, "leader", 2, runs=5)
    assert [p.fingerprint() for p in again] == [p.fingerprint() for p in formations[:2]]
    for problem in formations:
        cold, warm = problem.starts["cold"], problem.starts["warm"]
        assert not cold.x0.any()
        assert (cold.lbx < cold.ubx).any()
        np.testing.assert_array_equal(cold.p, warm.p)


@pytest.mark.slow
def test_formation_problems_of_mpc_are_those_of_its_horizon(scenario) -> None:
    problems = csw.formation_problems(scenario, ["leader-mpc-3"], 2, runs=3)
    assert [p.traits["policy"] for p in problems] == 2 * ["leader-mpc-3"]
    assert {p.nlp.sizes[0] for p in problems} == {3 * 2 * scenario.n}
    for problem in problems:
        assert not problem.starts["cold"].x0.any()
        for instance in problem.starts.values():
            assert csw.solvers.Ipopt().solve(problem.nlp, instance)[0].status.success


def test_guide_problems_are_those_of_the_search(scenario) -> None:
    (problem,) = csw.guide_problems(scenario.with_values({"guide.search": "local"}))
    assert (problem.name, problem.family) == ("wall guide 0", "wall guides")
    solution = csw.solvers.Ipopt().solve(problem.nlp, problem.starts["warm"])[0]
    assert solution.status.success


@pytest.mark.slow
def test_comparison_profile_and_report_of_own_problems(formations, tmp_path: Path) -> None:
    named = csw.Problem.from_casadi({"x": X, "f": ca.sumsqr(X - 1)}, "bowl", x0=3)
    named.to_nl(tmp_path / "bowl.nl")
    problems = [*formations[:2], *csw.read_problems([tmp_path])]
    assert problems[-1].family == tmp_path.name
    comparison = csw.compare(problems, ["ipopt", "spectral"], time_limit=60)
    profile = comparison.profile(tmp_path.name)
    assert profile.to_numpy().ravel().tolist() == [1.0]  # spectral does not apply
    assert list(comparison.profile("wall formations", "warm")) == ["ipopt", "spectral"]
    with pytest.raises(csw.ComparisonError, match="family 'walls' is unknown"):
        comparison.profile("walls")
    with pytest.raises(csw.ComparisonError, match="start 'hot' is unknown"):
        comparison.profile(start="hot")
    text = make_report(comparison).markdown()
    assert "| scenario: wall; members: 5; policy: leader" in text
    assert "random scenarios" not in text


def test_read_problems_leaves_out_or_raises(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.nl", tmp_path / "bad.nl"
    csw.Problem.from_casadi({"x": X, "f": ca.sumsqr(X)}).to_nl(good)
    bad.write_text("g3 1 1 0\n 2 0")
    refused: list[csw.ProblemError] = []
    assert [p.name for p in csw.read_problems([tmp_path], refused.append)] == ["good"]
    assert [error.file for error in refused] == [bad]
    for paths in ([tmp_path], [bad]):
        with pytest.raises(csw.ProblemError, match=r"bad\.nl, line 2: .*truncated"):
            csw.read_problems(paths)
    good.unlink()
    with pytest.raises(csw.ProblemError, match=r"no file NAME\.nl in this folder can be read"):
        csw.read_problems([tmp_path], refused.append)


def test_quick_family_describes_what_it_solved() -> None:
    table = _families(pd.DataFrame([p.as_row() for p in make_problems("quick")]))
    assert table["description"].tolist() == [
        "paths of a single agent among random radars; radars: 2; horizon: 10",
        "states of simulated runs among random radars; members: 3; policy: leader, constrained; "
        "rate: saturation, collision",
    ]

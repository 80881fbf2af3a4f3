"""Problems from elsewhere: cases of power flow, and the tables of their page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest

from casswarm.solvers import FilterInteriorPoint, Ipopt

CASE = """
function mpc = made % a comment = [1 2];
mpc.version = '2';
mpc.baseMVA = 100.0;
%% bus data
mpc.bus = [
  1 3 0.0  0.0 0.0 0.0 1 1.0 0.0 1.0 1 1.1 0.9;
  7 1 50.0 0.0 0.0 0.0 1 1.0 0.0 1.0 1 1.1 0.9; % a load
  9 4 99.0 0.0 0.0 0.0 1 1.0 0.0 1.0 1 1.1 0.9;
];
mpc.gen = [
  1 50 0 100 -100 1.0 100 1 200 0;
  7 50 0 100 -100 1.0 100 1 200 0;
  7 50 0 100 -100 1.0 100 0 200 0;
];
mpc.gencost = [
  2 0 0 3 0.0 10.0 5.0;
  2 0 0 3 0.0 20.0 0.0;
  2 0 0 3 0.0  0.0 0.0;
];
mpc.branch = [
  1 7 {r} 0.1 0.0 {limit} 0 0 0.0 0.0 1 -30 30;
  1 7 0.0 0.1 0.0 0       0 0 0.0 0.0 0 -30 30;
];
"""


@pytest.fixture(scope="module")
def elsewhere():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
        import elsewhere

        yield elsewhere


@pytest.fixture(scope="module")
def power_flow(elsewhere):  # noqa: ARG001
    return sys.modules["_power_flow"]


def written(folder: Path, text: str = CASE, r: float = 0.0, limit: float = 0.0) -> Path:
    path = folder / "made.m"
    path.write_text(text.format(r=r, limit=limit))
    return path


@pytest.mark.parametrize("solver", [FilterInteriorPoint(), Ipopt()])
def test_cheap_generator_supplies_load_over_line_without_losses(
    power_flow: Any, tmp_path: Path, solver: Any
) -> None:
    problem = power_flow.power_flow(power_flow.read_case(written(tmp_path)))
    assert problem.nlp.sizes == (8, 0, 5)  # two buses, two generators, and a line without a limit
    (solution,) = solver.solve(problem.nlp, problem.starts["given"])
    assert solution.status.success
    assert solution.objective == pytest.approx(505.0, rel=1e-6)


def test_losses_and_limits_cost(power_flow: Any, tmp_path: Path) -> None:
    costs = []
    for r, limit in ((0.0, 0.0), (0.05, 0.0), (0.0, 30.0)):
        case = power_flow.read_case(written(tmp_path, r=r, limit=limit))
        problem = power_flow.power_flow(case)
        (solution,) = Ipopt().solve(problem.nlp, problem.starts["given"])
        costs.append(solution.objective)
    # losses are r |I|^2 for a current of about 0.5 at voltages up to 1.1
    assert costs[1] - costs[0] == pytest.approx(10 * 100 * 0.05 * (0.5 / 1.1) ** 2, rel=0.05)
    assert costs[2] == pytest.approx(5 + 30 * 10 + 20 * 20, rel=1e-3)


def test_flows_are_those_of_admittances(power_flow: Any) -> None:
    rng = np.random.default_rng(5)
    r, x, charging = rng.uniform(0.01, 0.2, (3, 4))
    tap, shift = np.array([0.0, 0.95, 1.05, 0.0]), np.array([0.0, 0.0, 12.0, -7.0])
    zero = np.zeros(4)
    branch = np.stack([zero, zero, r, x, charging, zero, zero, zero, tap, shift], axis=1)
    va, vm = rng.uniform(-0.3, 0.3, 8), rng.uniform(0.9, 1.1, 8)
    ends = [[0, 1, 2, 3], [4, 5, 6, 7]]
    voltage = vm * np.exp(1j * va)
    ratio = np.where(tap == 0, 1.0, tap) * np.exp(1j * np.deg2rad(shift))
    series, shunt = 1 / (r + 1j * x), 0.5j * charging
    one, two = voltage[:4], voltage[4:]  # an ideal transformer, then a line with two shunts
    inner = one / ratio
    current = (inner - two) * series + inner * shunt
    expected = (
        one * np.conj(current / np.conj(ratio)),
        two * np.conj(two * shunt - series * (inner - two)),
    )
    for first in (0, 1):
        active, reactive = power_flow._flows(branch, ca.SX(va), ca.SX(vm), first, ends)
        found = np.array(ca.DM(active)).ravel() + 1j * np.array(ca.DM(reactive)).ravel()
        np.testing.assert_allclose(found, expected[first], rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mpc.gencost", "mpc.other", "gencost is missing"),
        ("mpc.baseMVA", "mpc.base", "baseMVA is missing"),
        ("2 0 0 3 0.0 10.0", "1 0 0 3 0.0 10.0", "costs are no polynomials"),
    ],
)
def test_other_cases_are_refused(
    power_flow: Any, tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        power_flow.read_case(written(tmp_path, CASE.replace(old, new)))


def test_published_objectives_are_read(power_flow: Any, tmp_path: Path) -> None:
    path = tmp_path / "BASELINE.md"
    path.write_text(
        "| **Case Name** | **Nodes** | **Edges** | **DC** | **AC** | **QC Gap** |\n"
        "| pglib_opf_case3_lmbd | 3 | 3 | 5.6959e+03 | 5.8126e+03 | 1.22 | 1.32 |\n"
        "| pglib_opf_case9 | 3 | 3 | n.a. | n.a. | 1.22 | 1.32 |\n"
    )
    found = power_flow.published(path)
    assert found["pglib_opf_case3_lmbd"] == 5812.6
    assert np.isnan(found["pglib_opf_case9"])


RUNS = pd.DataFrame(
    {
        "solver": ["interior-point", "interior-point", "ipopt", "ipopt"],
        "problem": ["hs071", "other", "hs071", "other"],
        "solved": [True, False, True, True],
        "reported_success": [True, False, True, True],
        "reported_status": ["solved", "infeasible", "solved", "solved"],
        "message": ["solved", "by ipopt: not below 1.5e-3: no", "Solve_Succeeded", ""],
        "objective": [17.0140173, 3.0, 18.0, 2.0],
        "solve_seconds": [0.01, 1.0, 0.02, 0.03],
    }
)


def test_false_claims_are_faults(elsewhere: Any) -> None:
    found = elsewhere.faults("files", RUNS)
    assert found == ["files: other is feasible", "files: 50.0% are solved; expected at least 90%"]
    claimed = RUNS.assign(reported_success=True)
    assert "files: other is a false success" in elsewhere.faults("files", claimed)
    assert elsewhere.faults("files", RUNS[RUNS["solved"]]) == []


def test_tables_count_successes_and_false_claims(elsewhere: Any) -> None:
    first, second = elsewhere.overview(RUNS).splitlines()[2:]
    assert first == "| `interior-point` | 2 | 1 | 50.0% | 0 | 0 | 1 | 10 |"
    assert second == "| `ipopt` | 2 | 2 | 100.0% | 0 | 0 | 0 | 25 |"
    assert elsewhere.failures(RUNS).splitlines()[2:] == ["| not below N | 1 | `other`† |"]
    rows = elsewhere.book(RUNS).splitlines()[2:]
    assert rows == [
        "| `interior-point` | 1 | 1 | 1 | 0 | 0 | 0 |",
        "| `ipopt` | 1 | 1 | 0 | 0 | 1 | 0 |",
    ]

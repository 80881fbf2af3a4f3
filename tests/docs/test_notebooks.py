"""Notebooks run, and their numbers support what their text states."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import python

pytestmark = pytest.mark.slow

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
CLAIMS = {
    "04_solver_comparison": """
import numpy as np

runs, summary = comparison.runs, comparison.summary
assert len(runs) == 2 * 5 * 2 * len(solvers), "problems of a kind, kinds, starts"
applicable = runs[runs["applicable"]]
assert set(runs.loc[~runs["applicable"], "family"]) == {"guides"}, "which are no product sets"

# claims of the text
best = applicable[applicable["solver"].isin(["ipopt", "spectral"])]
assert best["solved"].all(), best["reason"].tolist()
assert not summary["false_positives"].any(), "no false claims"
assert summary["solved"].min() < 1, "failures to be shown"
assert (summary["best_known"] < summary["solved"]).any(), "minima that are local"
assert (profile.iloc[-1] == np.isfinite(times).mean()).all(), "the right end is reliability"
fastest = fraction_at(profile, 1.0)
assert fastest["spectral"] + fastest["projected-gradient"] > 0.9, "the left end is speed"
mean = times.where(np.isfinite(times)).mean()
assert mean["spectral"] < mean["ipopt"], "evaluations are not time"
assert set(failures(runs)["solver"]) >= {"projected-gradient"}
assert "## Answer" in report.markdown()
""",
    "01_quickstart": """
assert guide.survival < around.survival <= around.survival_bound
rates = study.summary.set_index("policy")["success"]
assert rates["homing"] < rates["naive"] < rates["leader"]
for exact in distributions:
    assert abs(rates[exact.policy] - exact.success.low) < 0.12, "3 deviations of 200 runs"
""",
    "03_custom_hazard_and_policy": """
rates = study.summary.set_index("policy")["success"]
assert rates["leader"] < rates["constrained"] < rates["naive"], "protecting is the worst"
assert guide.risk_bound <= guide.risk
first, second = guide.best_per_homotopy_class()[:2]
assert first.homotopy != second.homotopy and second.risk < 1.05 * first.risk, "nearly as good"
lost = study.trajectories["leader"][0].positions[-1][~study.trajectories["leader"][0].alive[-1]]
towers_at = np.array(scenario.hazard.radars)
nearest = np.sort(np.hypot(*(lost[:, None] - towers_at).T).min(axis=0))
assert len(lost) >= 3 and nearest[2] < 2.0, "the others draw the fire; the leader may be lost later"
""",
    "07_own_solver": """
runs = comparison.runs.set_index("solver")
assert runs.loc[["ipopt", "hasty"], "reported_success"].all()
assert runs.loc["ipopt", "solved"].all()
assert not runs.loc["hasty", "solved"].all(), "false positives"
assert set(comparison.iterates["solver"]) == {"ipopt", "slsqp", "projected-gradient", "hasty"}
""",
    "09_policy_gradients": """
assert by_gradient[-1, 0] < 1.2 * same[-1, 0] < 0.1 * large[-1, 0], "budgets"
assert by_gradient[3, 1] > leader.high, "a few updates"
assert by_gradient[-1, 1] > joint.low - 0.03 and joint.high < bound.value
assert same[:, 1].max() < by_gradient[0, 1] + 0.005
assert large[-1, 1] > leader.high and large[large[:, 0] < 10 * budget, 1].max() < leader.low
assert large[-1, 1] < by_gradient[-1, 1] - 0.02
assert abs(exact.gradient @ direction - (high - low) / 2e-6) < 1e-6
""",
    "05_policies": """
assert (best["policy"] == "joint").all()
assert (table["success_high"] < table["bound"]).all()
rows = table.set_index(["scenario", "policy"])
for name in scenarios:
    assert rows.loc[(name, "naive"), "success_high"] < rows.loc[(name, "leader"), "success_low"]
""",
    "08_bounds": """
assert guide.survival < guide.survival_bound < 1.05 * guide.survival
assert game.value() < float(clocks[2]), "the game is sharper"
assert (np.diff(values, axis=0) <= 1e-9).all(), "lower levels are better"
assert (table["leader"] < table["joint"]).all()
assert (table["joint"] <= table["level game"]).all()
assert (table["level game"] <= table["clocks"]).all()
bracket = csw.optimal_value(barricade).success
assert bracket.high <= float(csw.success_bound(barricade)), "the oracle of both"
""",
}
"""Claims of the text, as code."""


@pytest.mark.parametrize("name", CLAIMS)
def test_notebook_supports_its_text(name: str, tmp_path: Path) -> None:
    # not as a script, which the processes of solvers would import and run again
    text = (NOTEBOOKS / f"{name}.py").read_text(encoding="utf-8")
    program = f"{text}\n{CLAIMS[name]}"
    python("-c", program, folder=tmp_path, timeout=None, MPLBACKEND="agg")


def test_paper_notebook_runs(tmp_path: Path) -> None:
    done = python(NOTEBOOKS / "02_paper.py", folder=tmp_path, MPLBACKEND="agg")
    assert "leader: success between 0.999" in done.stdout


def test_own_solver_notebook_has_at_most_15_lines_of_code() -> None:
    lines = (NOTEBOOKS / "07_own_solver.py").read_text(encoding="utf-8").splitlines()
    assert len([line for line in lines if line and not line.startswith("#")]) <= 15

"""Notebooks, run as they are; that on solvers has a small family."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

NOTEBOOK = Path(__file__).parents[1] / "notebooks" / "solver_comparison.py"

# not as a script: the processes that solvers run in would import and run it again
RUN = f"""
exec(compile(open({str(NOTEBOOK)!r}, encoding="utf-8").read(), "solver_comparison", "exec"))
import numpy as np

cells, summary = comparison.cells, comparison.summary
assert len(cells) == 2 * 5 * 2 * len(solvers), "problems of a kind, kinds, starts"
taken = cells[cells["taken"]]
assert set(cells.loc[~cells["taken"], "family"]) == {{"guides"}}, "which are no product sets"

# what the text says of the numbers beside it
best = taken[taken["solver"].isin(["ipopt", "spectral"])]
assert best["solved"].all(), best["reason"].tolist()
assert not summary["said_not_true"].any(), "no false claims"
assert summary["solved"].min() < 1, "failures to be shown"
assert (summary["found"] < summary["solved"]).any(), "minima that are local"
assert (profile.iloc[-1] == np.isfinite(times).mean()).all(), "the right end is reliability"
assert share_at(profile, 1.0)["spectral"] > 0.9, "the left end is speed"
mean = times.where(np.isfinite(times)).mean()
assert mean["spectral"] < mean["ipopt"], "evaluations are not time"
assert set(failures(cells)["solver"]) >= {{"projected-gradient"}}
assert "In short" in report.markdown()
print("done", len(cells))
"""


def test_solver_comparison_runs_and_shows_what_its_text_says(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", RUN],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=500,
        env=os.environ | {"MPLBACKEND": "agg"},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "done 80"


def test_the_paper_reproduced_runs(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", NOTEBOOK.parent / "paper.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=500,
        env=os.environ | {"MPLBACKEND": "agg"},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "leader: success between 0.999" in done.stdout

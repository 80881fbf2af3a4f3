"""casswarm compare on files, scenarios and solvers of one's own."""

import casadi as ca
import pandas as pd
import pytest
from commands import casswarm

import casswarm as csw

MODULE = """
from dataclasses import dataclass
from casswarm.solvers import Ipopt

@dataclass(frozen=True)
class Mine(Ipopt):
    name = "mine"

quick = Mine(max_iter=3)
number = 3
"""
X = ca.SX.sym("x", 2)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my_module.py").write_text(MODULE)
    (tmp_path / "files").mkdir()
    for name in ("one", "two"):
        problem = csw.Problem.from_casadi({"x": X, "f": ca.sumsqr(X - 1)}, name)
        problem.to_nl(tmp_path / "files" / f"{name}.nl")
    (tmp_path / "files" / "cut.nl").write_text("g3 1 1 0\n 2 0 1\n")
    return tmp_path


def test_compare_solves_files_with_own_solver(folder):
    options = ("--solver", "ipopt", "--solver", "my_module:Mine", "--time-limit", 60)
    done = casswarm(folder, "compare", "--problems", "files", *options, "--no-figures")
    assert (
        "left out: files/cut.nl, line 2: the file ends too early: is it truncated?" in done.stderr
    )
    assert "files, given start, 2 problems" in done.stdout
    runs = pd.read_csv(folder / "results" / "compare" / "runs.csv")
    assert sorted(set(runs["solver"])) == ["ipopt", "mine"]
    assert runs["solved"].all()


@pytest.mark.slow
def test_compare_solves_problems_of_scenarios(folder):
    options = ("--solver", "ipopt", "--count", 1, "--time-limit", 60, "--policy", "leader")
    done = casswarm(folder, "compare", "single-agent", "wall", *options, "--no-figures")
    for family in ("single-agent guides", "wall guides", "wall formations"):
        assert f"{family}, cold start, 1 problem" in done.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--problems", "files/cut.nl"), "files/cut.nl, line 2: the file ends too early"),
        (("--problems", "none.nl"), "none.nl: No such file or directory"),
        (
            ("--problems", "files", "--solver", "spectral"),
            "none of the solvers is applicable to any of the problems; spectral: ",
        ),
        (("--problems", "files", "--count", 2), "--count does not apply: all problems are those"),
        (("--policy", "leader"), "--policy does not apply: no scenario is given"),
        (("--allow-code",), "--allow-code does not apply: no scenario is given"),
        (("none.toml",), "none.toml"),
        (("--solver", "my_module:number"), "'my_module:number' is not derived from"),
        (("--solver", "my_module:none"), "has no function 'none'"),
        (("--solver", "nothing:Mine"), "cannot import the module 'nothing'"),
    ],
)
def test_compare_refuses_wrong_input(folder, options, message):
    done = casswarm(folder, "compare", *options, code=2)
    assert message in done.stderr
    assert not (folder / "results" / "compare" / "runs.csv").exists()

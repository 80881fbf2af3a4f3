"""casswarm solvers: what is there, what cannot run here, what was left out, each with a reason."""

from __future__ import annotations

import json
from pathlib import Path

import casadi
import pytest
from click.testing import CliRunner, Result

from casswarm.cli import main
from casswarm.comparison.run import _absent, _solvers
from casswarm.errors import SolverError
from casswarm.optimization.solvers import SOLVERS, UNSUPPORTED, casadi_nlpsol, make_solver


def listed(*options: str) -> Result:
    done = CliRunner().invoke(main, ["solvers", *options])
    assert done.exit_code == 0, done.output
    return done


@pytest.fixture
def without_uno(monkeypatch: pytest.MonkeyPatch) -> None:
    """An installation of CasADi that does not have Uno."""
    there = casadi_nlpsol.has_plugin
    monkeypatch.setattr(
        casadi_nlpsol, "has_plugin", lambda plugin: plugin != "uno" and there(plugin)
    )


def test_json_tells_every_ability_and_reason() -> None:
    told = json.loads(listed("--json").output)
    assert [row["name"] for row in told["solvers"]] == list(SOLVERS)
    for row in told["solvers"]:
        capabilities = SOLVERS[row["name"]].capabilities
        assert row["problems"] == capabilities.problems
        for ability in ("batch", "multipliers", "time_limit"):
            assert row[ability] is getattr(capabilities, ability)
        assert row["unavailable"] == ""
    assert told["left_out"] == UNSUPPORTED


def test_a_solver_that_cannot_run_here_is_listed_with_the_reason(without_uno: None) -> None:  # noqa: ARG001
    text = listed().output
    assert "Not usable in this installation:\nuno  the nlpsol plugin 'uno' is not in this" in text
    rows = {row["name"]: row for row in json.loads(listed("--json").output)["solvers"]}
    assert "plugin 'uno'" in rows["uno"]["unavailable"]
    with pytest.raises(SolverError, match="'uno' cannot run here: the nlpsol plugin 'uno'"):
        make_solver("uno")


def test_a_comparison_of_all_goes_on_without_what_cannot_run(without_uno: None) -> None:  # noqa: ARG001
    assert set(_absent()) == {"uno"}
    assert set(_solvers(None)) == set(SOLVERS) - {"uno"}


@pytest.mark.parametrize("name", UNSUPPORTED)
def test_asking_for_what_was_left_out_is_answered_with_the_reason(name: str) -> None:
    with pytest.raises(SolverError) as caught:
        make_solver(name)
    assert str(caught.value) == f"solver {name!r} is left out: {UNSUPPORTED[name]}"
    assert f"{name} " in listed().output


def test_every_nlpsol_of_the_wheel_is_taken_or_left_out_with_a_reason() -> None:
    files = Path(casadi.__file__).parent.glob("*casadi_nlpsol_*")
    adaptors = {file.name.partition("casadi_nlpsol_")[2].partition(".")[0] for file in files}
    taken = {getattr(kind, "plugin", "") for kind in SOLVERS.values()}
    assert "ipopt" in adaptors
    assert adaptors <= taken | set(UNSUPPORTED)

"""casswarm solvers: available, unavailable and unsupported solvers, with reasons."""

from __future__ import annotations

import json
import re
from pathlib import Path

import casadi
import pytest
from click.testing import CliRunner, Result

from casswarm.cli import main
from casswarm.comparison.run import _solvers, _unavailable
from casswarm.errors import SolverError
from casswarm.solvers import SOLVERS, UNSUPPORTED, make_solver
from casswarm.solvers import casadi_plugins as casadi_nlpsol


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


def test_solvers_json_lists_capabilities_and_reasons() -> None:
    content = json.loads(listed("--json").output)
    assert [row["name"] for row in content["solvers"]] == list(SOLVERS)
    for row in content["solvers"]:
        capabilities = SOLVERS[row["name"]].capabilities
        assert row["problems"] == capabilities.problems
        for capability in ("batch", "multipliers", "time_limit"):
            assert row[capability] is getattr(capabilities, capability)
        assert row["unavailable"] == SOLVERS[row["name"]].unavailable()
    assert content["unsupported"] == UNSUPPORTED


def test_unavailable_solver_is_listed_with_reason(without_uno: None) -> None:  # noqa: ARG001
    text = listed().output
    assert "Not available in this installation:\n" in text
    assert re.search(r"^uno +the nlpsol plugin 'uno' is not in this", text, re.MULTILINE)
    rows = {row["name"]: row for row in json.loads(listed("--json").output)["solvers"]}
    assert "plugin 'uno'" in rows["uno"]["unavailable"]
    with pytest.raises(SolverError, match="'uno' cannot run here: the nlpsol plugin 'uno'"):
        make_solver("uno")


def test_compare_of_all_omits_unavailable_solver(without_uno: None) -> None:  # noqa: ARG001
    assert "uno" in _unavailable()
    assert set(_solvers(None)) == set(SOLVERS) - set(_unavailable())


@pytest.mark.parametrize("name", UNSUPPORTED)
def test_unsupported_solver_is_refused_with_reason(name: str) -> None:
    with pytest.raises(SolverError) as caught:
        make_solver(name)
    assert str(caught.value) == f"solver {name!r} is not supported: {UNSUPPORTED[name]}"
    assert f"{name} " in listed().output


def test_every_nlpsol_plugin_is_supported_or_has_reason() -> None:
    files = Path(casadi.__file__).parent.glob("*casadi_nlpsol_*")
    adaptors = {file.name.partition("casadi_nlpsol_")[2].partition(".")[0] for file in files}
    taken = {getattr(kind, "plugin", "") for kind in SOLVERS.values()}
    assert "ipopt" in adaptors
    assert adaptors <= taken | set(UNSUPPORTED)

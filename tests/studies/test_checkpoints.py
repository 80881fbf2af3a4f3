"""Checkpoints of studies: records whose arrays are not those of the study are computed again, and a
study belongs to the code of the user that it calls, too.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import with_hazard
from slow_policy import toward
from small_scenarios import small
from sweep_cases import SMALL

import casswarm as csw
from casswarm._util.user_code import load

HEADER = len(b"casswarm record\n") + 32  # bytes before the hash of the arrays


def forge(path: Path, **changes: Any) -> None:
    """Change arrays of a record, None to remove one, and give the record its valid hash."""
    content = path.read_bytes()
    with np.load(io.BytesIO(content[HEADER + 32 :])) as saved:
        arrays = {name: np.array(value) for name, value in (dict(saved) | changes).items()}
    out = io.BytesIO()
    np.savez(out, **{name: value for name, value in arrays.items() if value.dtype != object})
    digest = hashlib.sha256(path.stem.encode() + b"\n" + out.getvalue()).digest()
    path.write_bytes(content[:HEADER] + digest + out.getvalue())


def simulated(**options: Any) -> csw.Study:
    return csw.simulate(SMALL, [toward], 10, **options)


def swept(**options: Any) -> csw.Sweep:
    return csw.sweep(SMALL, {"n": [2]}, [toward], runs=3, **options)


def huge(name: str) -> Callable[[str], str]:
    """Change of a result in which a column has a huge number."""

    def change(text: str) -> str:
        result = json.loads(text)
        result["columns"][name] = 10**30
        return json.dumps(result)

    return change


@pytest.mark.parametrize(
    "changes",
    [
        {"steps": np.ones(3, int)},
        *(
            pytest.param(changes, marks=pytest.mark.slow)
            for changes in (
                {"steps": None},
                {"arrival": np.full(10, "soon")},
                {"infeasible": np.zeros((10, 1), int)},
                {"first": np.zeros(2, int)},
                {"seconds": np.array("long")},
            )
        ),
    ],
    ids=str,
)
def test_simulate_computes_forged_record_again(tmp_path: Path, changes: dict[str, Any]) -> None:
    whole = simulated(checkpoint=tmp_path)
    (record,) = (tmp_path / "checkpoint").glob("*.npz")
    forge(record, **changes)
    assert simulated(checkpoint=tmp_path, if_exists="resume").runs.equals(whole.runs)


@pytest.mark.parametrize(
    "change",
    [
        *(
            pytest.param(lambda _, text=text: text, id=text[:30])
            for text in (
                "",
                "[" * 5000,
                "3",
                "{}",
                '{"columns": 1}',
                '{"columns": {"status": "ok"}, "seconds": 1}',
            )
        ),
        huge("runs"),
        huge("success"),
    ],
)
def test_sweep_computes_forged_record_again(tmp_path: Path, change: Any) -> None:
    whole = swept(checkpoint=tmp_path)
    record = tmp_path / "checkpoint" / "point-000000.npz"
    forge(record, json=np.array(change(str(_arrays(record)["json"]))))
    assert swept(checkpoint=tmp_path, if_exists="resume").table.equals(whole.table)
    assert json.loads(str(_arrays(record)["json"]))["columns"]["status"] == "ok"


def test_inputs_nested_too_deeply_are_lost(tmp_path: Path) -> None:
    swept(checkpoint=tmp_path)
    (inputs,) = (tmp_path / "checkpoint").glob("*.json")
    inputs.write_text("[" * 100_000)
    with pytest.raises(csw.CheckpointError, match="whose inputs are lost"):
        swept(checkpoint=tmp_path, if_exists="resume")


def _arrays(path: Path) -> dict[str, Any]:
    with np.load(io.BytesIO(path.read_bytes()[HEADER + 32 :])) as saved:
        return dict(saved)


# --- code of the user

POLICY = "def stay(step, positions, previous_velocities, alive):\n    return {} * positions\n"
RATE = "def rate(positions, alive):\n    return {} * alive\n"


def scenario() -> csw.Scenario:
    return small([(0.0, 0.0)], (1.0, 0.0), [(1.5, 0.8)], 4, guide__search="local")


def simulate(scenario: csw.Scenario, policy: Any, folder: Path) -> None:
    csw.simulate(scenario, [policy], 5, checkpoint=folder, if_exists="resume")


def sweep(scenario: csw.Scenario, policy: Any, folder: Path) -> None:
    settings = {"formation.rho": [0.1]}
    csw.sweep(scenario, settings, [policy], checkpoint=folder, if_exists="resume")


@pytest.mark.parametrize(
    ("study", "text", "named"),
    [
        (simulate, POLICY, r"belongs to other inputs:\n  code\.stay: "),
        (sweep, POLICY, r"belongs to other inputs:\n  code\.stay: "),
        (simulate, RATE, r"code\.hazard: "),
    ],
)
def test_study_with_changed_code_is_not_resumed(
    tmp_path: Path, study: Any, text: str, named: str
) -> None:
    for number, factor in enumerate((0.1, 0.1, 0.2)):
        folder = tmp_path / str(number)  # a process imports a file once
        folder.mkdir()
        (folder / "mine.py").write_text(text.format(factor))
        if text == POLICY:
            given = scenario(), load("mine:stay", folder)
        else:
            path = folder / "mine.toml"
            path.write_text(with_hazard(scenario().to_toml(), 'kind = "mine:rate"'))
            given = csw.load_scenario(path, allow_code=True), "leader"
        refused = pytest.raises(csw.CheckpointError, match=named) if number == 2 else nullcontext()
        with refused:
            study(*given, tmp_path / "results")

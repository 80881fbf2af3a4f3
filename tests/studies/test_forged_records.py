"""Records under a valid hash whose arrays are not those of the study: they are computed again."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow_policy import toward
from sweep_cases import SMALL

import casswarm as csw

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
    whole = csw.simulate(SMALL, [toward], 10, checkpoint=tmp_path)
    (record,) = (tmp_path / "checkpoint").glob("*.npz")
    forge(record, **changes)
    again = csw.simulate(SMALL, [toward], 10, checkpoint=tmp_path, if_exists="resume")
    assert again.runs.equals(whole.runs)


@pytest.mark.parametrize(
    "text",
    ["", "[" * 5000, "3", "{}", '{"columns": 1}', '{"columns": {"status": "ok"}, "seconds": 1}'],
)
def test_sweep_computes_forged_record_again(tmp_path: Path, text: str) -> None:
    options: dict[str, Any] = {"runs": 3, "checkpoint": tmp_path}
    whole = csw.sweep(SMALL, {"n": [2]}, [toward], **options)
    record = tmp_path / "checkpoint" / "point-000000.npz"
    forge(record, json=np.array(text))
    again = csw.sweep(SMALL, {"n": [2]}, [toward], **options, if_exists="resume")
    assert again.table.equals(whole.table)
    assert json.loads(str(_arrays(record)["json"]))["columns"]["status"] == "ok"


@pytest.mark.parametrize("name", ["runs", "success"])
def test_sweep_computes_record_with_huge_number_again(tmp_path: Path, name: str) -> None:
    options: dict[str, Any] = {"runs": 3, "checkpoint": tmp_path}
    whole = csw.sweep(SMALL, {"n": [2]}, [toward], **options)
    (record,) = (tmp_path / "checkpoint").glob("*.npz")
    result = json.loads(str(_arrays(record)["json"]))
    result["columns"][name] = 10**30
    forge(record, json=np.array(json.dumps(result)))
    again = csw.sweep(SMALL, {"n": [2]}, [toward], **options, if_exists="resume")
    assert again.table.equals(whole.table)


def test_inputs_nested_too_deeply_are_lost(tmp_path: Path) -> None:
    options: dict[str, Any] = {"runs": 3, "checkpoint": tmp_path}
    csw.sweep(SMALL, {"n": [2]}, [toward], **options)
    (inputs,) = (tmp_path / "checkpoint").glob("*.json")
    inputs.write_text("[" * 100_000)
    with pytest.raises(csw.CheckpointError, match="whose inputs are lost"):
        csw.sweep(SMALL, {"n": [2]}, [toward], **options, if_exists="resume")


def _arrays(path: Path) -> dict[str, Any]:
    with np.load(io.BytesIO(path.read_bytes()[HEADER + 32 :])) as saved:
        return dict(saved)

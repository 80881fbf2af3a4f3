"""Comparisons in folders, as ``casswarm compare`` writes them."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from .._util.documents import json_text
from .._util.files import atomic_write, read_table, require_file
from ..errors import ComparisonError
from .convergence import COLUMNS

if TYPE_CHECKING:
    from .result import Comparison

RECORD = "run.json"

TEXTS = ("message", "violated_row", "reason")
"""Columns of texts that can be empty."""

_MAX_BYTES = 2_000_000_000
_DAMAGED = (AttributeError, LookupError, OSError, RecursionError, TypeError, ValueError)


def saved_tables(comparison: Comparison) -> dict[str, pd.DataFrame]:
    """Tables that a comparison is restored from, by the names of their files."""
    return {
        "runs": comparison.runs,
        "traits": comparison.problems,
        "iterates": comparison.iterates,
    }


def write_comparison(comparison: Comparison, folder: Path) -> None:
    """See `Comparison.save`."""
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"{name}.csv" for name in saved_tables(comparison)]
    for name, table in saved_tables(comparison).items():
        atomic_write(folder / f"{name}.csv", table.to_csv(index=False))
    record = {
        "command": "compare",
        "inputs": comparison.inputs,
        "versions": comparison.inputs["versions"],
        "files": dict.fromkeys([*names, RECORD], ""),
        "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    atomic_write(folder / RECORD, json_text(record) + "\n")


def read_comparison(
    folder: Path,
) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, Any], pd.DataFrame]:
    """Runs, problems, inputs and iterates of a comparison; see `Comparison.load`."""
    try:
        require_file(folder / RECORD, _MAX_BYTES)
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        if record["command"] != "compare":
            raise ComparisonError(f"{folder} was written by casswarm {record['command']}")
        inputs = dict(record["inputs"])
        runs = _table(folder, "runs")
        for name in runs.columns.intersection(list(TEXTS)):
            runs[name] = ["" if pd.isna(text) else text for text in runs[name]]
        missing = {"family", "problem", "start", "solver", "solved"} - set(runs)
        if missing or "time_limit" not in inputs:
            raise ComparisonError(f"{folder} lacks {', '.join(sorted(missing)) or 'time_limit'}")
        problems, iterates = _table(folder, "traits"), _table(folder, "iterates")
        if problems.empty:  # not saved, so their sizes are unknown
            problems = runs[["family", "problem"]].drop_duplicates(ignore_index=True)
            problems = problems.assign(variables=math.nan, constraints=math.nan)
    except FileNotFoundError as error:
        raise ComparisonError(
            f"{folder} holds no comparison: it has no {Path(str(error.filename)).name}"
        ) from None
    except ComparisonError:
        raise
    except _DAMAGED as error:
        raise ComparisonError(f"the comparison in {folder} cannot be read: {error}") from error
    return runs, problems, inputs, iterates


def _table(folder: Path, name: str) -> pd.DataFrame:
    """A table; empty if it has no rows, or is of iterates or traits that were not saved."""
    path = folder / f"{name}.csv"
    if name != "runs" and not path.exists():
        return pd.DataFrame(columns=list(COLUMNS) if name == "iterates" else [])
    require_file(path, _MAX_BYTES)
    return read_table(path)

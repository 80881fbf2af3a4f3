"""Comparisons in folders, as ``casswarm compare`` writes them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from .._util.documents import json_text
from .._util.files import (
    DAMAGED,
    RECORD,
    atomic_write,
    digest,
    listed,
    read_record,
    read_table,
    time_stamp,
)
from ..errors import ComparisonError
from .convergence import COLUMNS

if TYPE_CHECKING:
    from .result import Comparison

TEXTS = ("message", "violated_row", "reason")
"""Columns of texts that can be empty."""


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
    tables = {f"{name}.csv": table for name, table in saved_tables(comparison).items()}
    for name, table in tables.items():
        atomic_write(folder / name, table.to_csv(index=False))
    record = {
        "command": "compare",
        "inputs": comparison.inputs,
        "versions": comparison.inputs["versions"],
        "files": listed({name: digest(folder / name) for name in tables}),
        "finished": time_stamp(),
    }
    atomic_write(folder / RECORD, json_text(record) + "\n")


def read_comparison(
    folder: Path,
) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, Any], pd.DataFrame]:
    """Runs, problems, inputs and iterates of a comparison; see `Comparison.load`."""
    try:
        record = read_record(folder)
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
    except DAMAGED as error:
        raise ComparisonError(f"the comparison in {folder} cannot be read: {error}") from error
    return runs, problems, inputs, iterates


def _table(folder: Path, name: str) -> pd.DataFrame:
    """A table; empty if it has no rows, or is of iterates or traits that were not saved."""
    path = folder / f"{name}.csv"
    if name != "runs" and not path.exists():
        return pd.DataFrame(columns=list(COLUMNS) if name == "iterates" else [])
    return read_table(path)

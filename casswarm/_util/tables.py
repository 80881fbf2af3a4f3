"""Tables in CSV files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd


def read_table(path: Path) -> pd.DataFrame:
    """Table of a CSV file, its numbers equal to the last bit; only empty cells are missing."""
    table: pd.DataFrame = pd.read_csv(
        path, keep_default_na=False, na_values=[""], **_exact_numbers()
    )
    return table


def _exact_numbers() -> dict[str, Any]:
    """Option for pandas to read numbers to the last bit; from 3.1 on it always does."""
    release = tuple(map(int, pd.__version__.split(".")[:2]))
    return {} if release >= (3, 1) else {"float_precision": "round_trip"}

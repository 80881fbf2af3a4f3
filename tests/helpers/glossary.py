"""The terms of docs/glossary.md, and the columns of tables that it does not explain."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

from casswarm.policies import POLICIES

ROOT = Path(__file__).resolve().parents[2]
TERMS = set(re.findall(r"`([^`]+)`", (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")))


def unexplained(tables: Iterable[Path]) -> dict[str, list[str]]:
    """Columns without an entry, by table; names of policies and numbers are placeholders."""
    policies = re.compile(rf"^({'|'.join(sorted(POLICIES, key=len, reverse=True))})(?=_|$)")
    missing: dict[str, list[str]] = {}
    for table in tables:
        with table.open(encoding="utf-8", newline="") as file:
            header = next(csv.reader(file))
        for column in header:
            name = re.sub(r"(?<=_)\d+", "N", policies.sub("POLICY", column))
            if name not in TERMS:
                missing.setdefault(table.name, []).append(column)
    return missing

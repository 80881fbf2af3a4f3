"""run.json, the record of a command: its reading, and the files that it lists."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._util.files import require_file

RECORD = "run.json"

MAX_RECORD = 200_000_000
"""Largest size in bytes of a record that is read."""


def read_record(folder: Path) -> Any:
    """Content of run.json in a folder.

    Raises
    ------
    OSError
        There is none, or it is not a regular file of limited size.
    ValueError, RecursionError
        It is not JSON.
    """
    file = folder / RECORD
    require_file(file, MAX_RECORD)
    return json.loads(file.read_text(encoding="utf-8"))


def own_record(folder: Path) -> Mapping[str, Any]:
    """Record that casswarm wrote in a folder; empty if there is none."""
    try:
        record = read_record(folder)
    except (OSError, ValueError, RecursionError):
        return {}
    is_own = isinstance(record, dict) and "casswarm" in (record.get("versions") or ())
    return record if is_own else {}


def recorded_files(record: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the files that a record lists, by name; empty where an older one has names only.

    Names with a folder, which no command writes, are left out.
    """
    files = record.get("files") or {}
    listed = files if isinstance(files, dict) else dict.fromkeys(map(str, files), "")
    return {name: str(value) for name, value in listed.items() if Path(name).name == name}

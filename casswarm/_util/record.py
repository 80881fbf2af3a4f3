"""run.json, the record of a results folder: what it says of other files, and how two differ."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .files import DAMAGED, read_json

RECORD = "run.json"


def read_record(folder: Path) -> Any:
    """Content of run.json in a folder; one of `files.DAMAGED` if there is none."""
    return read_json(folder / RECORD)


def own_record(folder: Path) -> Mapping[str, Any]:
    """Record that casswarm wrote in a folder; empty if there is none."""
    try:
        record = read_record(folder)
    except DAMAGED:
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


def listed(files: Mapping[str, str]) -> dict[str, str]:
    """Hashes of the files of a folder as its record lists them; its own is not known."""
    return dict(sorted({**files, RECORD: ""}.items()))


def time_stamp() -> str:
    """Date and time of now, in UTC."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def differences(first: Any, second: Any) -> dict[str, tuple[Any, Any]]:
    """Pairs of values that differ, by dotted key; None where one has no such key.

    Nested dictionaries are compared key by key.
    """
    a, b = _flat(first), _flat(second)
    return {key: (a.get(key), b.get(key)) for key in a | b if a.get(key) != b.get(key)}


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    if not isinstance(value, dict):
        return {key: value}
    return {
        inner: leaf
        for name, item in value.items()
        for inner, leaf in _flat(item, f"{key}.{name}" if key else f"{name}").items()
    }

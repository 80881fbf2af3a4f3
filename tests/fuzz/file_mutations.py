"""Mutations of the files that casswarm writes: run.json, tables, saved arrays, records."""

from __future__ import annotations

import io
import json
import tomllib
import zipfile
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import tomli_w
from mutations import mutated, mutated_bytes, mutated_scenario
from oddities import odd_number, odd_text

HEADER = 48  # bytes of a record before the hash of its arrays


def mutate_file(path: Path, rng: Random) -> None:
    """Change a file of a results folder, by its structure or by its bytes."""
    content = path.read_bytes()
    by_suffix = {".json": _mutated_json, ".csv": _mutated_table, ".npz": mutated_arrays}
    if rng.random() < 0.2:
        path.unlink()
        if rng.random() < 0.3:
            path.mkdir()
    elif rng.random() < 0.7 and path.suffix in by_suffix:
        path.write_bytes(by_suffix[path.suffix](content, rng))
    else:
        path.write_bytes(mutated_bytes(content, rng))


def _json_bytes(data: Any) -> bytes:
    return json.dumps(data, default=str).encode(errors="surrogatepass")


def _mutated_json(content: bytes, rng: Random) -> bytes:
    data = json.loads(content)
    if "scenario" in data and rng.random() < 0.4:
        scenario = mutated_scenario(tomllib.loads(data["scenario"]), rng)
        data["scenario"] = tomli_w.dumps(scenario)
        return _json_bytes(data)
    return _json_bytes(mutated(data, rng))


def _mutated_table(content: bytes, rng: Random) -> bytes:
    rows = [line.split(",") for line in content.decode().splitlines()]
    row = rng.choice(rows)
    column = rng.randrange(len(row))
    change = rng.randrange(6)
    if change <= 1:
        row[column] = rng.choice((str(odd_number(rng)), odd_text(rng), "", '"'))
    elif change == 2:
        for cells in rows:
            del cells[column : column + 1]
    elif change == 3:
        rows[1:] = rng.sample(rows[1:], rng.randint(0, len(rows) - 1))
    elif change == 4:
        rows += rows[1:] * rng.choice((1, 100))
    else:
        for cells in rows[1:]:
            cells[column : column + 1] = [rng.choice(("nan", "inf", "", "-1e308", "text"))]
    return "\n".join(map(",".join, rows)).encode(errors="replace")


def mutated_arrays(content: bytes, rng: Random) -> bytes:
    """A file of arrays with other arrays: of other types and shapes, missing, odd, or a bomb."""
    with np.load(io.BytesIO(content), allow_pickle=False) as loaded:
        arrays = dict(loaded)
    name = rng.choice(sorted(arrays))
    if "json" in arrays and rng.random() < 0.5:
        structure = mutated(json.loads(str(arrays["json"])), rng)
        arrays["json"] = np.array(json.dumps(structure, default=str))
    elif rng.random() < 0.15:
        return _bomb(arrays, name, rng)
    elif rng.random() < 0.15:
        del arrays[name]
    else:
        arrays[name] = _mutated_array(arrays[name], rng)
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def _mutated_array(array: np.ndarray, rng: Random) -> np.ndarray:
    if array.dtype.kind not in "fiub" or rng.random() < 0.2:
        number = np.array(max(-1e308, min(1e308, odd_number(rng))), float)
        return rng.choice((number, np.array("text"), np.zeros(0)))
    changed = array.copy()
    if changed.size and rng.random() < 0.5:
        with np.errstate(all="ignore"):
            value = rng.choice((np.nan, np.inf, -1.0, 1e300, 2.0**40))
            changed.reshape(-1)[rng.randrange(changed.size)] = np.array(value).astype(changed.dtype)
        return changed
    odd = (
        changed[..., None],
        np.atleast_1d(changed)[:1],
        changed.ravel()[:-1],
        changed.astype(str),
        changed.T,
    )
    return rng.choice((*odd, np.concatenate([changed.ravel()] * 3)))


def _bomb(arrays: dict[str, np.ndarray], name: str, rng: Random) -> bytes:
    """A file one of whose arrays claims to be huge, or is huge when it is unpacked."""
    out = io.BytesIO()
    np.savez_compressed(out, **{key: value for key, value in arrays.items() if key != name})
    shape = rng.choice(("(10000000000,)", "(400000000,)", "(100000, 100000)", "(-1,)", "(2, 0)"))
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    data = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + header.encode()
    with zipfile.ZipFile(out, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{name}.npy", data + b"\0" * rng.choice((0, 80, 10**7)))
    return out.getvalue()


# --- records of a study


def mutate_records(folder: Path, rng: Random) -> None:
    """Damage a folder of records as disks and people do: no file keeps a valid hash."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        path = rng.choice(sorted(folder.iterdir()))
        rng.choice((_damage, _damage, _damage, _misplace, _replace, _add))(path, rng)


def _damage(path: Path, rng: Random) -> None:
    if path.is_file():
        path.write_bytes(mutated_bytes(path.read_bytes(), rng))


def _misplace(path: Path, rng: Random) -> None:
    """Copy a file to the name of another one."""
    other = rng.choice(sorted(path.parent.iterdir()))
    if path.is_file() and other.is_file():
        other.write_bytes(path.read_bytes())


def _replace(path: Path, rng: Random) -> None:
    """Put a folder, a link or nothing in the place of a file."""
    if path.is_dir():
        return
    path.unlink()
    what = rng.randrange(4)
    if what == 0:
        path.mkdir()
    elif what == 1:
        path.symlink_to(rng.choice(("nowhere", path.name, "/dev/null", "..")))
    elif what == 2:
        path.write_bytes(rng.randbytes(rng.choice((0, 10, 1_000))))


def _add(path: Path, rng: Random) -> None:
    """Add files of odd names."""
    names = (".part-1-x.npz", "point-9.npz", "notes.txt", "-.npz", "\u202e.npz", "x.npz.bak")
    added = path.with_name(rng.choice(names))
    if not added.exists():
        added.write_bytes(path.read_bytes() if path.is_file() else b"")


def forge_record(path: Path, rng: Random) -> None:
    """Change the arrays of a record, and give them their valid hash."""
    from casswarm._util.checkpoint import _digest

    content = path.read_bytes()
    arrays = mutated_arrays(content[HEADER + 32 :], rng)
    path.write_bytes(content[:HEADER] + _digest(path.stem, arrays) + arrays)

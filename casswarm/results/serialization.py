"""Results as arrays and JSON: written once, read back equal to the last bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from ..bounds import AccelerationBound, Certificate, Level, SuccessBound
from ..chain.distribution import OutcomeDistribution
from ..chain.monte_carlo import RunTrajectory
from ..grid import CostToGoMap
from ..guide.guide import Candidate, Guide
from ..nlp.solution import Residuals, Solution, Status

_TYPES: dict[str, type[Any]] = {
    kind.__name__: kind
    for kind in (
        AccelerationBound,
        Candidate,
        Certificate,
        CostToGoMap,
        Guide,
        Level,
        OutcomeDistribution,
        Residuals,
        RunTrajectory,
        Solution,
        Status,
        SuccessBound,
    )
}
"""Classes whose objects can be saved."""


def pack(value: Any) -> dict[str, np.ndarray]:
    """Convert a value to named arrays, as `numpy.savez` takes them; `unpack` is the inverse.

    Mappings with text keys, lists, tuples, arrays, numbers, texts, None, and
    objects of the classes of this module can be converted. The array ``json`` holds the structure.
    """
    arrays: list[np.ndarray] = []
    structure = json.dumps(_encode(value, arrays))
    return {"json": np.array(structure)} | {f"array{k}": part for k, part in enumerate(arrays)}


def unpack(arrays: Mapping[str, np.ndarray]) -> Any:
    """Convert the arrays of `pack` back to the value."""
    return _decode(json.loads(str(arrays["json"])), arrays)


def _encode(value: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    name = type(value).__name__
    if isinstance(value, Enum):
        return {"type": name, "value": value.value}
    if isinstance(value, Guide):
        value = replace(value, candidates=())  # many, and for no figure
    if is_dataclass(value):
        if name not in _TYPES:
            raise TypeError(f"{name} objects cannot be saved")
        parts = {item.name: getattr(value, item.name) for item in fields(value)}
        return {"type": name, "fields": {k: _encode(v, arrays) for k, v in parts.items()}}
    if isinstance(value, Mapping):
        return {"items": {key: _encode(item, arrays) for key, item in value.items()}}
    if isinstance(value, tuple):
        return {"tuple": [_encode(item, arrays) for item in value]}
    if isinstance(value, list):
        return [_encode(item, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _decode(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(value, list):
        return [_decode(item, arrays) for item in value]
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[f"array{value['array']}"]
    if "tuple" in value:
        return tuple(_decode(item, arrays) for item in value["tuple"])
    if "items" in value:
        return {key: _decode(item, arrays) for key, item in value["items"].items()}
    kind = _TYPES[value["type"]]
    if "value" in value:
        return kind(value["value"])
    return kind(**{key: _decode(item, arrays) for key, item in value["fields"].items()})

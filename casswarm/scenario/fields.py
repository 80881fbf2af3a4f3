"""The kinds of values that a scenario holds: their limits, and the words that describe them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

SMALLEST, LARGEST = 1e-9, 1e9
"""Limits of every number, so that no square or quotient of two of them over- or underflows."""


@dataclass(frozen=True)
class Allowed:
    """What a key may hold, in plain words: completes 'must be ...' in error messages."""

    words: str


_RANGE = f"(from {SMALLEST:g} to {LARGEST:g})"

Number = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST),
    Allowed(f"a number between {-LARGEST:g} and {LARGEST:g}"),
]
Positive = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=SMALLEST, le=LARGEST),
    Allowed(f"a number above 0 {_RANGE}"),
]
NotNegative = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=0.0, le=LARGEST),
    Allowed(f"a number, 0 or above (at most {LARGEST:g})"),
]
Count = Annotated[
    int,
    Field(strict=True, ge=1, le=int(LARGEST)),
    Allowed(f"a whole number from 1 to {LARGEST:g}"),
]
Switch = Annotated[bool, Field(strict=True), Allowed("true or false")]
Text = Annotated[str, Field(strict=True), Allowed("a text in quotes")]
Point = Annotated[tuple[Number, Number], Allowed(f"[x, y], two numbers up to {LARGEST:g}")]


def plain(value: object) -> Any:
    """`value` with NumPy arrays and scalars, however deep inside, as lists and numbers."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if type(value) in (list, tuple):
        return [plain(item) for item in value]  # type: ignore[attr-defined]
    return value

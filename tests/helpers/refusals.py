"""Calls that are refused: the error with its values, which survive pickling."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from casswarm.errors import CasswarmError


def declared(kind: type) -> set[str]:
    """Names of the values that a class of errors and its bases declare."""
    return {name for base in kind.__mro__ for name in vars(base).get("__annotations__", {})}


def refused(kind: type[CasswarmError], call: Callable[..., object], *arguments: Any) -> Any:
    """The error of exactly this class that a call raises."""
    with pytest.raises(kind) as caught:
        call(*arguments)
    error = caught.value
    again = pickle.loads(pickle.dumps(error))
    assert type(error) is type(again) is kind
    assert str(again) == str(error)
    for name in declared(kind):
        np.testing.assert_equal(getattr(again, name, None), getattr(error, name, None), name)
    return error

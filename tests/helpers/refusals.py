"""The message with which a call is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from casswarm.errors import HazardError


def refused(call: Callable[..., object], *arguments: Any, **keywords: Any) -> str:
    """Message of the error about a hazard that a call raises."""
    with pytest.raises(HazardError) as caught:
        call(*arguments, **keywords)
    return str(caught.value)

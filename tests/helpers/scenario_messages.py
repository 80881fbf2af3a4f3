"""Messages of scenario errors."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from casswarm.errors import ScenarioError


def message(action: Callable[..., object], *arguments: object, **keywords: object) -> str:
    """Message of the error that a call raises."""
    with pytest.raises(ScenarioError) as caught:
        action(*arguments, **keywords)
    text = str(caught.value)
    assert "pydantic" not in text
    assert "Input should" not in text
    return text

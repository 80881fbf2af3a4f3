"""Scenario files with replaced text, and messages of scenario errors."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from casswarm.errors import ScenarioError
from casswarm.scenario import load_scenario


def message(action: Callable[..., object], *arguments: object, **keywords: object) -> str:
    """Message of the error that a call raises."""
    with pytest.raises(ScenarioError) as caught:
        action(*arguments, **keywords)
    text = str(caught.value)
    assert "pydantic" not in text
    assert "Input should" not in text
    return text


def edited(*replacements: tuple[str, str]) -> bytes:
    """File of paper-1 with replaced text."""
    text = load_scenario("paper-1").to_toml()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    return text.encode()

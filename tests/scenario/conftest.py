"""Fixtures of scenario tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from casswarm.scenario import Scenario, load_scenario


@pytest.fixture
def paper() -> Scenario:
    return load_scenario("paper-1")


@pytest.fixture
def file(tmp_path: Path, paper: Scenario) -> Callable[..., Path]:
    """Function that writes paper-1 with replaced text."""

    def write(*replacements: tuple[str, str]) -> Path:
        text = paper.to_toml()
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "my.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write

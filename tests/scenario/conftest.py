"""Fixtures of scenario tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from scenario_messages import edited

from casswarm.scenario import Scenario, load_scenario


@pytest.fixture
def paper() -> Scenario:
    return load_scenario("paper-1")


@pytest.fixture
def file(tmp_path: Path) -> Callable[..., Path]:
    """Function that writes paper-1 with replaced text."""

    def write(*replacements: tuple[str, str]) -> Path:
        path = tmp_path / "my.toml"
        path.write_bytes(edited(*replacements))
        return path

    return write

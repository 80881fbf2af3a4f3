"""Parameters of tests that run for every solver of this installation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from casswarm.solvers import SOLVERS

GENERAL = [name for name, kind in SOLVERS.items() if kind.capabilities.problems == "any"]


def needs(name: str) -> pytest.MarkDecorator:
    """Mark of a test that is skipped where a solver cannot run."""
    reason = SOLVERS[name].unavailable()
    return pytest.mark.skipif(bool(reason), reason=reason)


def each(names: Iterable[str]) -> list[Any]:
    """Parameters of a test, one a solver's name; those that cannot run here are skipped."""
    return [pytest.param(name, marks=needs(name)) for name in names]

"""Parameters of tests that run for every solver of this installation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from casswarm.solvers import SOLVERS


def each(names: Iterable[str]) -> list[Any]:
    """Parameters of a test, one a solver's name; those that cannot run here are skipped."""
    reasons = {name: SOLVERS[name].unavailable() for name in names}
    return [
        pytest.param(name, marks=pytest.mark.skipif(bool(reason), reason=reason))
        for name, reason in reasons.items()
    ]

"""Texts of messages."""

from __future__ import annotations

import numpy as np
import pytest

import casswarm as csw
from casswarm._util.text import shown


@pytest.mark.parametrize("value", [np.float64(13.4), np.array(13.4), 13.4])
def test_numpy_scalar_is_shown_as_a_number(value: object) -> None:
    assert shown(value) == "13.4"


def test_message_on_a_numpy_scalar_shows_the_number() -> None:
    with pytest.raises(csw.SolverError, match=r"tolerance = -1\.5; allowed"):
        csw.FilterInteriorPoint(tolerance=np.float64(-1.5))

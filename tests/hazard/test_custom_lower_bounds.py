"""Lower bounds of a user's rates over boxes, and the check of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hazard_cases import Array

from casswarm.errors import HazardError
from casswarm.hazard import CustomHazard


def ramp(positions: ca.MX, alive: ca.MX) -> ca.MX:  # noqa: ARG001
    return 1 + positions[:, 0] ** 2


def dip(positions: ca.MX, alive: ca.MX) -> ca.MX:  # noqa: ARG001
    return 2 - ca.exp(-(((positions[:, 0] - 0.3) / 0.2) ** 2))


def at_centre(lower: Array, upper: Array) -> Array:
    return np.asarray(1 + (0.5 * (lower + upper))[..., 0] ** 2)


def at_corners_and_centre(lower: Array, upper: Array) -> Array:
    x = np.stack([lower, upper, 0.5 * (lower + upper)])[..., 0]
    return np.asarray((2 - np.exp(-(((x - 0.3) / 0.2) ** 2))).min(axis=0))


@pytest.mark.parametrize(
    ("rate", "bound", "where"),
    [
        (ramp, at_centre, r"it is 1\.25 for the box from \(0, 0\) to \(1, 1\), where .* is 1$"),
        (dip, at_corners_and_centre, r"it is 1\.63212 for the box from \(0, 0\) to \(1, 1\)"),
    ],
)
@pytest.mark.parametrize("count", [1, 500])
def test_lower_bound_above_rate_in_a_box_raises(
    rate: Callable[..., Any], bound: Callable[..., Array], where: str, count: int
) -> None:
    hazard = CustomHazard(rate, lower_bound=bound)
    lower, upper = np.zeros((count, 2)), np.ones((count, 2))
    with pytest.raises(HazardError, match=where):
        hazard.single_agent_lower_bound(lower, upper)


def test_lower_bound_of_nan_raises() -> None:
    def undefined(lower: Array, upper: Array) -> Array:  # noqa: ARG001
        return np.where(lower[..., 0] == 7, np.nan, 0.0)

    lower = np.arange(900.0)[:, None] + np.zeros(2)
    hazard = CustomHazard(ramp, lower_bound=undefined)
    with pytest.raises(HazardError, match=r"it is nan for the box from \(7, 7\) to \(8, 8\)"):
        hazard.single_agent_lower_bound(lower, lower + 1)


def test_lower_bound_below_rates_is_returned() -> None:
    hazard = CustomHazard(ramp, lower_bound=lambda lower, upper: 1 + 0 * (lower + upper)[..., 0])
    lower = np.linspace(0, 1, 600).reshape(30, 10, 2)
    assert hazard.single_agent_lower_bound(lower, lower + 1).shape == (30, 10)

"""Constants that rooms share which need not import CasADi."""

from __future__ import annotations

SPEED_TOL = 1e-12
"""Excess over v_max or a_max, relative to v_max, up to which the chain does not project a velocity;
the bounds on all policies allow for it."""

CORE_RADIUS = 0.01
"""Default distance below which rates are regularised, of hazards that are made in Python."""

CORE_FRACTION = 1 / 50
"""The same of a scenario, as a fraction of the target's radius."""

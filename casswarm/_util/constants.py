"""Constants that rooms share which need not import CasADi."""

from __future__ import annotations

SPEED_TOL = 1e-12
"""Excess over v_max or a_max, relative to v_max, up to which the chain does not project a velocity;
the bounds on all policies allow for it."""

CORE_RADIUS = 0.01
"""Distance below which rates are regularised; members must start farther from radars."""

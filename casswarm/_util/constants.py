"""Constants that rooms share which need not import CasADi."""

from __future__ import annotations

CORE_RADIUS = 0.01
"""Distance below which rates are regularised; members must start farther from radars."""

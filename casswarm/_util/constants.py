"""Numbers that several modules share."""

from __future__ import annotations

CORE_RADIUS = 0.01
"""Distance below which rates are regularised: nearer than this to a radar is inside it."""

"""Spaces of observations and actions."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from ..policies.observation import Observation


def observation_space(observation: Observation) -> Box:
    """Box (n, d) of all observations that can occur."""
    low, high = observation.bounds()
    return Box(low, high, dtype=low.dtype.type)


def action_space(observation: Observation) -> Box:
    """Box (n, 2) of velocities within v_max."""
    dtype = np.dtype(observation.dtype).type
    limit = dtype(observation.v_max)
    return Box(-limit, limit, (observation.n, 2), dtype)


def member_space(space: Box, member: int) -> Box:
    """Row of a member in a space of all members."""
    return Box(space.low[member], space.high[member], dtype=space.low.dtype.type)

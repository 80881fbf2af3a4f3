"""Registration of the environments with Gymnasium."""

from __future__ import annotations

import gymnasium

ENV_ID = "casswarm/Swarm-v0"
"""Name for `gymnasium.make` and `gymnasium.make_vec`."""


def register() -> None:
    """Register `ENV_ID`; once is enough, and again does nothing."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            ENV_ID,
            entry_point="casswarm.envs:SwarmEnv",
            vector_entry_point="casswarm.envs:SwarmVectorEnv",
            kwargs={"scenario": "paper-1"},
        )

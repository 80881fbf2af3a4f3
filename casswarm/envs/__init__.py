"""Environments for learning libraries, for which the extra ``casswarm[rl]`` is needed.

Importing this package registers ``casswarm/Swarm-v0`` with Gymnasium.
"""

import lazy_loader

from .._util.extras import require_extra

require_extra("rl", "gymnasium")

import gymnasium  # noqa: E402  (an error of ours comes first)

if "casswarm/Swarm-v0" not in gymnasium.registry:
    gymnasium.register(
        "casswarm/Swarm-v0",
        entry_point="casswarm.envs:SwarmEnv",
        vector_entry_point="casswarm.envs:SwarmVectorEnv",
        kwargs={"scenario": "paper-1"},
    )

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Environments for learning libraries, for which the extra ``casswarm[rl]`` is needed.

Importing this package registers ``casswarm/Swarm-v0`` with Gymnasium.
"""

import lazy_loader

from .._util.extras import require_extra

require_extra("rl", "gymnasium")

from .registration import register  # noqa: E402  (an error of ours comes first)

register()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Joint plans: trajectories of all members for the success of the swarm; see ``docs/joint.md``."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

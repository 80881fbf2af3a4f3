"""Policies: the velocities of all members, from the state of the swarm."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

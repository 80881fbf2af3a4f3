"""The motion of members in a step: limits of velocity, their sets in the plane, and projection."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Grids of positions in time, dynamic programming on them, and value functions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

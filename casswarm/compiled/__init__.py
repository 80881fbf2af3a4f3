"""Compiled code: kernels, how they are linked, their threads, and the files that keep them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

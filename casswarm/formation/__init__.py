"""The formation problems of the paper's section IV.B: their sets, their methods, one step or H."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Explanations of infeasible programs: sets of rows and bounds that contradict each other."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

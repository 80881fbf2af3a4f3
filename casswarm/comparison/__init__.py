"""Comparison of solvers: benchmark problems, runs, verification, profiles and a report."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

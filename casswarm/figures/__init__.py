"""Figures: functions that take data and return a matplotlib Figure, neither shown nor written.

They are drawn in the theme of their context, ``with theme("column"): ...``; see `THEMES`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

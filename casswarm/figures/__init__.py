"""Figures: functions that take data and return a matplotlib Figure, neither shown nor written.

They are drawn in the theme of their context, ``with theme("column"): ...``; see `THEMES`. All take

- ``title``: a text instead of the default title, or None for no title;
- ``ax``: axes of matplotlib to draw into, whose figure is returned; a sequence of as many for
  figures of several panels, which have no common title then.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

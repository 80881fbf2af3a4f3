"""Themes of figures: sizes fit for print, and colours that colour-blind readers can distinguish."""

from .._util.figure_style import THEMES, theme

__all__ = ["THEMES", "theme"]

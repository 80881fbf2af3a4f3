"""Numbers of the command line."""

from __future__ import annotations

import math
from typing import Any

import click


class Number(click.FloatRange):
    """A number of a range, neither NaN nor infinite; `infinite` allows it to be infinite."""

    def __init__(
        self, low: float, high: float | None = None, *, infinite: bool = False, **settings: Any
    ) -> None:
        super().__init__(low, high, **settings)
        self.infinite = infinite

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Number that a text means."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number) or (math.isinf(number) and not self.infinite):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number

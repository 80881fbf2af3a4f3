"""Styles of policies: the same colour, dashes and marker in every figure."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from zlib import crc32

from .style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION


@dataclass(frozen=True)
class PolicyStyle:
    """Colour, dashes and marker of a policy, which also differ in print without colours."""

    color: str
    dashes: Any
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """Arguments of ``Axes.plot``."""
        return {"color": self.color, "linestyle": self.dashes, "marker": self.marker}


POLICIES = {
    "naive": PolicyStyle(VERMILION, "-", "o"),
    "constrained": PolicyStyle(GREEN, (0, (5, 1.5)), "s"),
    "leader": PolicyStyle(BLUE, (0, (6, 1.5, 1, 1.5)), "D"),
    "constrained-feedback": PolicyStyle(ORANGE, (0, (3, 1)), "^"),
    "leader-feedback": PolicyStyle(SKY, (0, (2, 1, 1, 1)), "v"),
    "joint": PolicyStyle(PURPLE, (0, (1, 1)), "P"),
    "joint-replanning": PolicyStyle("#882255", (0, (4, 1, 1, 1)), "p"),  # darker shade
    "optimal": PolicyStyle("#555555", (0, (10, 2)), "X"),
    "constrained-mpc": PolicyStyle("#00573F", (0, (8, 1.5, 1, 1.5)), "d"),  # darker shade
    "leader-mpc": PolicyStyle("#003B6F", (0, (3, 1, 1, 1, 1, 1)), "*"),  # darker shade
}
"""Styles of the built-in policies in every figure; MPC policies of all horizons share one."""

_OTHERS = (
    PolicyStyle(INK, (0, (8, 2)), "X"),
    PolicyStyle(GREY, (0, (4, 1, 1, 1, 1, 1)), "h"),
    PolicyStyle("#7A5195", (0, (1, 2)), "<"),
    PolicyStyle("#8B5A2B", (0, (10, 2, 2, 2)), ">"),
)


def policy_styles(names: Iterable[str]) -> dict[str, PolicyStyle]:
    """Style of every policy, distinct as long as there are enough; users' own by their names."""
    styles: dict[str, PolicyStyle] = {}
    for name in dict.fromkeys(map(str, names)):
        first = crc32(name.encode()) % len(_OTHERS)
        builtin = POLICIES.get(re.sub(r"-mpc-\d+$", "-mpc", name))
        choices = [builtin] if builtin else []
        choices += [*_OTHERS[first:], *_OTHERS[:first]]
        unused = [style for style in choices if style not in styles.values()]
        styles[name] = (unused or choices)[0]
    return styles

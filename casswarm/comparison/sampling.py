"""What a family of problems is a sample of: independent units, and fixed numbers of every kind.

Problems of other families than those of `casswarm.comparison.problems` are independent, and all of
one kind.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence

_GUIDE = re.compile(r"guide-\d+-(\d+)")
_STATE = re.compile(r"(.+-\d+-.+)-\d+")


def sampling_units(family: str, problems: Iterable[str]) -> list[str]:
    """What is drawn when a problem is, for each problem: itself, or all guides of its radars.

    Guides are named guide-HORIZON-NUMBER. Those of a number have the same radars at every horizon,
    so they are not independent.
    """
    names = list(problems)
    if family != "guides":
        return names
    return [match[1] if (match := _GUIDE.fullmatch(name)) else name for name in names]


def strata(family: str, units: Sequence[str]) -> list[str]:
    """Kind of each unit, of which there are fixed numbers in a sample.

    Formations are named POLICY-MEMBERS-RATE-NUMBER, with as many numbers of every kind. If there is
    a single one of some kind, all are taken as of one kind, which overestimates the variance.
    """
    kinds = [""] * len(units)
    if family == "formations":
        kinds = [match[1] if (match := _STATE.fullmatch(name)) else "" for name in units]
    return kinds if min(Counter(kinds).values()) > 1 else [""] * len(units)

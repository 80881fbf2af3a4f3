"""Optima of the problems of Hock and Schittkowski's book, and where answers are beside them."""

from __future__ import annotations

import re

import pandas as pd

DIGITS = 1e-4
"""Relative distance to an optimum, of which some are published with few digits."""

PLACES = ("published optimum", "below", "above", "not published")

# W. Hock, K. Schittkowski, Test Examples for Nonlinear Programming Codes, Springer, 1981
_FIRST = (
    *(0, 0.0504261879, 0, 8 / 3, -1.91322295, 0, -1.73205081, -1, -0.5, -1),
    *(-8.498464223, -30, 1, 1.39346498, 306.5, 0.25, 1, 5, -6961.81381, 38.19873),
    *(-99.96, 1, 2, -1, 0, 0, 0.04, 0, -22.627417, 1),
    *(6, 1, -4.585786, -0.83403244, 1 / 9, -3300, -3456, 0, -1, -0.25),
    *(1.92592593, 13.8578644, -44, -15, 1, 0, 0, 0, 0, 0),
    *(0, 5.32664756, 4.09302326, -0.90807476, 19 / 3, -3.456, 0.02845967),
)
PUBLISHED = dict(enumerate(_FIRST, start=1))
PUBLISHED |= {
    **{59: -7.80423595, 60: 0.03256820, 61: -143.6461422, 62: -26272.51448, 63: 961.7151721},
    **{64: 6299.842428, 65: 0.9535288567, 66: 0.5181632741, 67: -1162.03651, 68: -0.9204250},
    **{69: -956.71288, 70: 0.007498464, 71: 17.0140173, 72: 727.67937, 73: 29.894378},
    **{74: 5126.4981, 75: 5174.4129, 76: -4.681818181, 77: 0.24150513, 78: -2.91970041},
    **{79: 0.0787768209, 80: 0.0539498478, 81: 0.0539498478, 83: -30665.53867},
    **{84: -5280335.133, 85: -1.90513375, 86: -32.34867897, 87: 8927.5977, 93: 135.075961},
    **dict.fromkeys((88, 89, 90, 91, 92), 1.36265681),
    **{95: 0.015619514, 96: 0.015619514, 97: 3.1358091, 98: 3.1358091, 99: -831079892},
    **{100: 680.6300573, 101: 1809.76476, 102: 911.880571, 103: 543.667958},
    **{104: 3.9511634396, 105: 1138.416240, 106: 7049.330923, 107: 5055.011803},
    **{108: -0.8660254038, 109: 5362.06928, 110: -45.77846971, 111: -47.75997},
    **{112: -47.707579, 113: 24.3062091, 114: -1768.80696, 116: 97.588409},
    **{117: 32.34867897, 118: 664.82045, 119: 244.899698},
}


def number_of(name: str) -> int:
    """Number of the problem of a file's name; 0 for variants, such as hs21mod."""
    found = re.fullmatch(r"hs0*(\d+)", name, re.IGNORECASE)
    return int(found[1]) if found else 0


def place(row: pd.Series) -> str:
    """Where an answer is with respect to the published optimum; empty if it is none."""
    if not row["solved"]:
        return ""
    optimum = PUBLISHED.get(number_of(row["problem"]))
    if optimum is None:
        return "not published"
    difference = (row["objective"] - optimum) / max(1.0, abs(optimum))
    if abs(difference) <= DIGITS:
        return "published optimum"
    return "below" if difference < 0 else "above"

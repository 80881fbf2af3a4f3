"""Values that nobody means: numbers, texts and nested data that programs tend to forget."""

from __future__ import annotations

import datetime
import math
from random import Random
from typing import Any

NUMBERS: tuple[float, ...] = (
    *(0, -0.0, -1, 1, 3, 0.1),
    *(-1e-20, 5e-324, 1e-320, 1e-20, 1e20, 1e150, 1e308, math.inf, -math.inf, math.nan),
    *(2**31, 2**53 + 1, 2**63, -(2**63) - 1, 2**64, 10**30, 10**4000),
)
TEXTS: tuple[str, ...] = (
    *("", " ", "\0", "\x1b[31mred\x1b]0;title\x07"),
    *("\u202egnp.exe", "\u200b\ufeff\u2028", "e\u0301\u0301\u0301", "𝟙٣"),
    *("$HOME", "$\\frac{$ \\undefined ^_", "%s %n {0} {x!r}", "<script>alert(1)</script>"),
    *("../../etc/passwd", "/dev/null", "a/b\\c", "line\nbreak\r\n", "'\"`;|&"),
    *("NaN", "null", "true", "1e400"),
    *("guide", "global", "horizon", "os:getcwd", "no_such_module:rate"),
    *("saturation", "saturation+collision", "=1+1", "x" * 5_000),
)


def odd_number(rng: Random) -> float:
    """A number, ordinary or at the edge of what is representable."""
    if rng.random() < 0.3:
        return rng.choice((1, -1)) * 10.0 ** rng.uniform(-30, 30)
    return rng.choice(NUMBERS)


def odd_text(rng: Random) -> str:
    """A text with what terminals, file systems, formulas and shells interpret."""
    text = rng.choice(TEXTS)
    return text + rng.choice(TEXTS) if rng.random() < 0.2 else text


def odd_value(rng: Random, depth: int = 0) -> Any:
    """Any value that a TOML file can hold."""
    roll = rng.random()
    if roll < 0.45:
        return odd_number(rng)
    if roll < 0.65:
        return odd_text(rng)
    if roll < 0.75:
        return rng.choice((True, False, [], {}, [[]], [{}]))
    if roll < 0.80:
        return rng.choice((datetime.date(1, 1, 1), datetime.datetime(2030, 1, 1), datetime.time()))
    if roll < 0.90 and depth < 4:
        return [odd_value(rng, depth + 1) for _ in range(rng.randint(1, 4))]
    if roll < 0.96 and depth < 4:
        return {odd_text(rng): odd_value(rng, depth + 1) for _ in range(rng.randint(1, 4))}
    return long_value(rng)


def long_value(rng: Random) -> Any:
    """A list, a table or a text that is long, or a list that is deep."""
    size = rng.choice((100, 1_000, 20_000))
    kind = rng.randrange(5)
    if kind == 0:
        return [[float(k), 0.0] for k in range(size // 10)]
    if kind == 1:
        return [0.0] * size
    if kind == 2:
        return {f"key{k}": k for k in range(size // 10)}
    if kind == 3:
        return "long " * size
    value: Any = []
    for _ in range(rng.choice((10, 60))):
        value = [value]
    return value


def odd_argument(rng: Random) -> str:
    """A text that can be an argument of a command: without the null character."""
    words = ("0", "-1", "nan", "inf", "1e309", "1e-320", "0x10", "1_000", "１２", "--", "-", "1,2")
    text = rng.choice((*words, *TEXTS, "9" * 400, "9" * 5_000, "[" * 3_000, "\udcff\udc80"))
    return text.replace("\0", "\x01")

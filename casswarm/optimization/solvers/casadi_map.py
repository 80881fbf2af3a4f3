"""A program's objective and gradient for many instances in one call, by CasADi's `Function.map`."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ...typing import FloatArray
from ..problem import Nlp

CHUNK = 256  # instances in one call at the most


def gradients(nlp: Nlp, x: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Objectives (B,) and gradients (B, nx) at x (B, nx); not finite where they do not exist.

    Batches are padded to powers of two, so that few maps are made.
    """
    f, gradient = np.empty(len(x)), np.empty_like(x)
    for first in range(0, len(x), CHUNK):
        rows = slice(first, first + CHUNK)
        f[rows], gradient[rows] = _chunk(nlp, x[rows], parameters[rows])
    return f, gradient


def _chunk(nlp: Nlp, x: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    size = 1 << max(0, len(x) - 1).bit_length()
    pad = ((0, size - len(x)), (0, 0))
    f, gradient = _mapped(nlp, size)(np.pad(x, pad, "edge").T, np.pad(parameters, pad, "edge").T)
    return np.asarray(f)[0, : len(x)], np.asarray(gradient).T[: len(x)]


@lru_cache(maxsize=64)
def _mapped(nlp: Nlp, size: int) -> Any:
    return nlp.gradient.map(size)

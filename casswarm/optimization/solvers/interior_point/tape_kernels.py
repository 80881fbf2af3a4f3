"""The compiled loop over the operations of a tape."""

from __future__ import annotations

import math

import numpy as np

from ...._util.jit import kernel
from ....typing import FloatArray, IntArray
from .lane_kernels import LANES


@kernel
def evaluate(
    operations: IntArray,
    constants: FloatArray,
    places: FloatArray,
    inputs: FloatArray,
    results: FloatArray,
) -> None:
    """Write the outputs (B, n) of a tape at inputs (B, m); `places` are (size, LANES)."""
    for first in range(0, len(inputs), LANES):
        number = min(LANES, len(inputs) - first)
        for k in range(len(operations)):
            code, target, one, two = operations[k]
            if code == 0:
                for lane in range(number):
                    places[target, lane] = inputs[first + lane, two]
            elif code == 1:
                for lane in range(number):
                    results[first + lane, two] = places[one, lane]
            elif code == 2:
                places[target] = constants[k]
            else:
                apply(code, places[one], places[two], places[target])


@kernel
def apply(code: int, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
    """Apply an operation to all lanes."""
    if code == 3:  # assign
        for k in range(LANES):
            out[k] = x[k]
    elif code == 4:  # add
        for k in range(LANES):
            out[k] = x[k] + y[k]
    elif code == 5:  # sub
        for k in range(LANES):
            out[k] = x[k] - y[k]
    elif code == 6:  # mul
        for k in range(LANES):
            out[k] = x[k] * y[k]
    elif code == 7:  # div
        for k in range(LANES):
            out[k] = x[k] / y[k]
    elif code == 8:  # neg
        for k in range(LANES):
            out[k] = -x[k]
    elif code == 9:  # inv
        for k in range(LANES):
            out[k] = 1.0 / x[k]
    elif code == 10:  # sq
        for k in range(LANES):
            out[k] = x[k] * x[k]
    elif code == 11:  # twice
        for k in range(LANES):
            out[k] = 2.0 * x[k]
    elif code == 12:  # sqrt
        for k in range(LANES):
            out[k] = math.sqrt(x[k])
    elif code == 13:  # exp
        for k in range(LANES):
            out[k] = math.exp(x[k])
    elif code == 14:  # log
        for k in range(LANES):
            out[k] = math.log(x[k])
    elif code == 15 or code == 16:  # pow
        for k in range(LANES):
            out[k] = x[k] ** y[k]
    elif code == 17:  # sin
        for k in range(LANES):
            out[k] = math.sin(x[k])
    elif code == 18:  # cos
        for k in range(LANES):
            out[k] = math.cos(x[k])
    elif code == 19:  # tan
        for k in range(LANES):
            out[k] = math.tan(x[k])
    elif code == 20:  # asin
        for k in range(LANES):
            out[k] = math.asin(x[k])
    elif code == 21:  # acos
        for k in range(LANES):
            out[k] = math.acos(x[k])
    elif code == 22:  # atan
        for k in range(LANES):
            out[k] = math.atan(x[k])
    elif code == 23:  # sinh
        for k in range(LANES):
            out[k] = math.sinh(x[k])
    elif code == 24:  # cosh
        for k in range(LANES):
            out[k] = math.cosh(x[k])
    elif code == 25:  # tanh
        for k in range(LANES):
            out[k] = math.tanh(x[k])
    elif code == 26:  # asinh
        for k in range(LANES):
            out[k] = math.asinh(x[k])
    elif code == 27:  # acosh
        for k in range(LANES):
            out[k] = math.acosh(x[k])
    elif code == 28:  # atanh
        for k in range(LANES):
            out[k] = math.atanh(x[k])
    elif code == 29:  # atan2
        for k in range(LANES):
            out[k] = math.atan2(x[k], y[k])
    elif code == 30:  # floor
        for k in range(LANES):
            out[k] = np.floor(x[k])
    elif code == 31:  # ceil
        for k in range(LANES):
            out[k] = np.ceil(x[k])
    elif code == 32:  # fabs
        for k in range(LANES):
            out[k] = abs(x[k])
    elif code == 33:  # sign
        for k in range(LANES):
            out[k] = np.sign(x[k])
    elif code == 34:  # fmin
        for k in range(LANES):
            out[k] = np.fmin(x[k], y[k])
    elif code == 35:  # fmax
        for k in range(LANES):
            out[k] = np.fmax(x[k], y[k])
    elif code == 36:  # lt
        for k in range(LANES):
            out[k] = 1.0 if x[k] < y[k] else 0.0
    elif code == 37:  # le
        for k in range(LANES):
            out[k] = 1.0 if x[k] <= y[k] else 0.0
    elif code == 38:  # eq
        for k in range(LANES):
            out[k] = 1.0 if x[k] == y[k] else 0.0
    elif code == 39:  # ne
        for k in range(LANES):
            out[k] = 1.0 if x[k] != y[k] else 0.0
    elif code == 40:  # not
        for k in range(LANES):
            out[k] = 1.0 if x[k] == 0.0 else 0.0
    elif code == 41:  # and
        for k in range(LANES):
            out[k] = 1.0 if x[k] != 0.0 and y[k] != 0.0 else 0.0
    elif code == 42:  # or
        for k in range(LANES):
            out[k] = 1.0 if x[k] != 0.0 or y[k] != 0.0 else 0.0
    elif code == 43:  # if_else_zero
        for k in range(LANES):
            out[k] = y[k] if x[k] != 0.0 else 0.0
    elif code == 44:  # erf
        for k in range(LANES):
            out[k] = math.erf(x[k])
    elif code == 45:  # log1p
        for k in range(LANES):
            out[k] = math.log1p(x[k])
    elif code == 46:  # expm1
        for k in range(LANES):
            out[k] = math.expm1(x[k])
    elif code == 47:  # hypot
        for k in range(LANES):
            out[k] = math.hypot(x[k], y[k])
    elif code == 48:  # copysign
        for k in range(LANES):
            out[k] = math.copysign(x[k], y[k])

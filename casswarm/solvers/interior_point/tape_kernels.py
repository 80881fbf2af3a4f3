"""The compiled loop over the scalar operations of a tape, for batches of arguments."""

from __future__ import annotations

from ...compiled.kernels import kernel, stand_in
from ...typing import FloatArray, IntArray
from .iterate_kernels import LANES

operate = stand_in
"""Does an operation of `tape.NUMBERS` on lanes: of (code, one, two, out, places)."""


@kernel
def evaluate(
    operations: IntArray,
    constants: FloatArray,
    inputs: tuple[FloatArray, ...],
    places: FloatArray,
    results: FloatArray,
) -> None:
    """Write the stacked outputs (n, b) of a tape at inputs (m, b) to `results`.

    `places` are (size, LANES), `operations` and `constants` those of `Tape`.
    """
    batch = results.shape[1]
    for first in range(0, batch, LANES):
        number = min(LANES, batch - first)
        for k in range(len(operations)):
            code, target, left, right = operations[k]
            if code == 0:
                values = inputs[left]
                for lane in range(number):
                    places[target, lane] = values[right, first + lane]
            elif code == 1:
                for lane in range(number):
                    results[right, first + lane] = places[left, lane]
            elif code == 2:
                for lane in range(LANES):
                    places[target, lane] = constants[k]
            else:
                operate(code, left, right, target, places)

"""Compiled loops of potentials."""

from __future__ import annotations

from ..._util.jit import kernel
from ...typing import FloatArray


@kernel
def limit_slope(values: FloatArray, straight: float, diagonal: float) -> None:
    """Lower node values (n, m) until neighbours differ by at most `straight` or `diagonal`.

    The result is the largest such function below the values. Two sweeps suffice but for rounding;
    they are repeated until nothing changes.
    """
    rows, columns = values.shape
    changed = True
    while changed:
        changed = False
        for sweep in range(2):
            step = 1 - 2 * sweep
            for row in range(rows):
                i = row if sweep == 0 else rows - 1 - row
                for column in range(columns):
                    j = column if sweep == 0 else columns - 1 - column
                    best = values[i, j]
                    if 0 <= j - step < columns:
                        best = min(best, values[i, j - step] + straight)
                    if 0 <= i - step < rows:
                        best = min(best, values[i - step, j] + straight)
                        if j > 0:
                            best = min(best, values[i - step, j - 1] + diagonal)
                        if j + 1 < columns:
                            best = min(best, values[i - step, j + 1] + diagonal)
                    if best < values[i, j]:
                        values[i, j] = best
                        changed = True

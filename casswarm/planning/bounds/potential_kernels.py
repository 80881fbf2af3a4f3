"""Compiled loops of potentials: slope limits, and the largest drops of a step by level."""

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


@kernel
def largest_drops(
    before: FloatArray, after: FloatArray, spacing: float, width: float, drops: FloatArray
) -> None:
    """Largest drop of a step by level, written to `drops` (M,), -1e300 where no node is.

    Parameters
    ----------
    before, after : (n, m)
        Level of every node before the step, and the least level within reach of it afterwards.
    spacing, width : float
        Entry a is for the nodes whose level differs from a `spacing` by at most `width`; the last
        entry also for all nodes above, whose levels count as its own.
    """
    last = len(drops) - 1
    top = last * spacing
    drops[:] = -1e300
    for i in range(before.shape[0]):
        for j in range(before.shape[1]):
            level = before[i, j]
            if level > top + width:
                drops[last] = max(drops[last], top - after[i, j])
                continue
            first = max(0, int((level - width) / spacing))
            for a in range(first, last + 1):
                if a * spacing > level + width:
                    break
                if a * spacing >= level - width:
                    drops[a] = max(drops[a], level - after[i, j])

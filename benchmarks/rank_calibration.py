"""How often the first solver of a ranking is the right one, against the stated probability.

Run with the installed package::

    python benchmarks/rank_calibration.py            # 4000 simulated comparisons each, some minutes
    python benchmarks/rank_calibration.py --quick    # 300

Two solvers are compared on n simulated problems. Their log times are normal, either independent of
one another without failures, or with a part that both share and failures on 10 to 20 % of the
problems, which count as a long time. The difference of their means is normal, too, so that a
calibrated probability p of the first rank would be right in a fraction p of the comparisons.
"""

from __future__ import annotations

import numpy as np
from _timing import arguments, print_table
from numpy.typing import NDArray

from casswarm.comparison.profiles import rank_probabilities, resampled_means

Array = NDArray[np.float64]
SIZES = (8, 12, 20, 30, 60)
BINS = ((0.5, 0.8), (0.8, 0.9), (0.9, 0.97), (0.97, 1.01))
FAILED = 7.0  # log time of a failure
SPREAD = 0.7  # standard deviation of the difference of the mean log times


def comparison(rng: np.random.Generator, n: int, fails: bool) -> tuple[Array, int]:
    """Log times (n, 2) of two solvers, and the one whose true mean is less."""
    means = np.array([0.0, rng.normal(0, SPREAD)])
    if not fails:
        return rng.normal(size=(n, 2)) + means, int(np.argmin(means))
    rates = 0.1 + 0.1 * rng.random(2)
    logs = rng.normal(size=(n, 1)) + 0.5 * rng.normal(size=(n, 2)) + means
    logs = np.where(rng.random((n, 2)) < rates, FAILED, logs)
    return logs, int(np.argmin((1 - rates) * means + rates * FAILED))


def calibration(n: int, fails: bool, comparisons: int) -> list[str]:
    """Mean stated probability and the fraction that was right, by bins of the former."""
    rng = np.random.default_rng([n, fails])
    said, right = np.empty(comparisons), np.empty(comparisons, bool)
    for k in range(comparisons):
        logs, true = comparison(rng, n, fails)
        first = int(np.argmin(logs.mean(axis=0)))
        said[k] = rank_probabilities(resampled_means(logs, resamples=400))[first, 0]
        right[k] = first == true
    cells = []
    for low, high in BINS:
        inside = (said >= low) & (said < high)
        text = f"{said[inside].mean():.2f}: {100 * right[inside].mean():.0f} % of {inside.sum()}"
        cells.append(text if inside.any() else "-")
    return cells


def main() -> None:
    """Print a row for every number of problems and kind of times."""
    comparisons = 300 if arguments(__doc__).quick else 4000
    kinds = {False: "normal log times", True: "10 to 20 % failures"}
    rows = [
        [kind, f"{n}", *calibration(n, fails, comparisons)]
        for fails, kind in kinds.items()
        for n in SIZES
    ]
    head = [f"{low:g} to {min(high, 1):g}" for low, high in BINS]
    print_table(["times", "problems", *head], rows)


if __name__ == "__main__":
    main()

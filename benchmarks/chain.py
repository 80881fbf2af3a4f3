"""Performance of the chain: exact laws, predictions, runs, Monte Carlo, growth, sweeps.

Run with the installed package::

    python benchmarks/chain.py              # all, about a quarter of an hour on two cores
    python benchmarks/chain.py distributions sweep   # some parts
    python benchmarks/chain.py --quick      # fewer runs, repeats and points

Prints Markdown tables and writes them as CSV, and the figure of growth, to ``results/chain`` of the
current folder (or ``--out``). Compiled code is cached on disk before anything is timed. Machines
are shared, so CPU times are given beside wall-clock times, and ratios are of one run.
"""

from __future__ import annotations

from inspect import getdoc

import pandas as pd
from _chain_exact import distributions, prediction, versus
from _chain_growth import growth, growth_chart, sweep
from _chain_sampling import coverage, equal, estimates, runs
from _timing import arguments, print_table

PARTS = {
    part.__name__: part
    for part in (
        distributions,
        prediction,
        runs,
        equal,
        versus,
        estimates,
        coverage,
        growth,
        sweep,
    )
}


def main() -> None:
    """Print the tables, and write them to --out."""
    options = arguments(__doc__, PARTS, out="results/chain")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.parts:
        table = pd.DataFrame(PARTS[name](options.quick))
        table.to_csv(options.out / f"{name}.csv", index=False)
        print(f"\n{getdoc(PARTS[name])}\n")
        print_table(list(table.columns), table.itertuples(index=False))
        if name == "growth":
            growth_chart(table, options.out / "growth.png")


if __name__ == "__main__":
    main()

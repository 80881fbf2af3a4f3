"""The upper bound on the success of every policy against its effort, and its time.

Run with the installed package::

    python benchmarks/success_bound.py

Prints a Markdown table of the scenarios of `policies.py`.
"""

from __future__ import annotations

from _timing import print_table
from policies import cases

import casswarm as csw

WORKS = (1e6, csw.planning.bounds.success_bound.MAX_WORK, 1.5e8)


def main() -> None:
    """Print the table."""
    rows = []
    for name, scenario in cases().items():
        clocks = csw.success_bound(scenario, max_work=0)
        games = [csw.success_bound(scenario, max_work=work, accuracy=0.0) for work in WORKS]
        cells = [f"{bound.value:.4f} ({bound.seconds:.1f} s)" for bound in (clocks, *games)]
        rows.append((name, *cells))
    columns = ("scenario", "independent clocks", *(f"level game, {work:.3g}" for work in WORKS))
    print_table(columns, rows)


if __name__ == "__main__":
    main()

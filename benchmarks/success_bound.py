"""The upper bound on the success of every policy against its effort, and its time.

Run with the installed package::

    python benchmarks/success_bound.py [MEMBERS]

Prints a Markdown table of the scenarios of `policies.py`, or of their first members.
"""

from __future__ import annotations

import sys

from _timing import print_table
from policies import cases

import casswarm as csw
from casswarm._util.numbers import rounded_up
from casswarm.scenario.variations import with_parameters

WORKS = (0.0, 6e7, 1.5e8)
COLUMNS = ("scenario", "independent clocks", "level game, default", "`max_work=1.5e8`")


def main() -> None:
    """Print the table; bounds are rounded up."""
    rows = []
    fewer = {"n": int(sys.argv[1])} if len(sys.argv) > 1 else {}
    for name, full in cases().items():
        scenario = with_parameters(full, fewer)
        bounds = [csw.success_bound(scenario, max_work=work) for work in WORKS]
        cells = [f"{rounded_up(bound.value):.4f} ({bound.seconds:.1f} s)" for bound in bounds]
        rows.append((name, *cells))
    print_table(COLUMNS, rows)


if __name__ == "__main__":
    main()

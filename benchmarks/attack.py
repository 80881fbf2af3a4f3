"""A random search for violated claims of casswarm, on ordinary and extreme scenarios.

Run with the installed package::

    python benchmarks/attack.py --minutes 10              # all claims in rotation
    python benchmarks/attack.py --only risk success       # some of them
    python benchmarks/attack.py --replay risk 17          # one draw again

Every draw checks one claim on a new scenario. A draw is determined by the claim and its seed. The
claims are compared with programs that share no code with casswarm where that is possible: the
equations in plain NumPy, Ipopt on problems written here, Dykstra's projections. Exits with 1 if a
claim was violated, or a draw raised an exception that is not one of casswarm's own.
"""

from __future__ import annotations

import argparse
import itertools
import logging
import sys
import time
import traceback
from collections.abc import Callable, Iterator

import numpy as np
from _attack_bounds import joint, risk, success
from _attack_chain import enumeration, intervals, limits, sampling
from _attack_images import files, images
from _attack_mixtures import cases, mixtures
from _attack_records import Check, Record, Skip, Trial
from _attack_scenarios import Rng
from _attack_solver import solver
from _timing import print_table

import casswarm as csw
from casswarm.errors import CasswarmWarning

CLAIMS: dict[str, Callable[[Rng], Iterator[Check] | Iterator[Trial]]] = {
    "risk": risk,
    "success": success,
    "enumeration": enumeration,
    "sampling": sampling,
    "intervals": intervals,
    "limits": limits,
    "solver": solver,
    "images": images,
    "joint": joint,
    "mixtures": mixtures,
    "cases": cases,
    "files": files,
}


def run_draw(claim: str, seed: int, record: Record, verbose: bool = False) -> None:
    """Check a claim on one draw; violations are printed with the line that reproduces them."""
    rng = np.random.default_rng([seed, *claim.encode()])
    record.draws += 1
    again = f"python benchmarks/attack.py --replay {claim} {seed}"
    try:
        for entry in CLAIMS[claim](rng):
            record.add(entry)
            violated = isinstance(entry, Check) and not entry.holds
            if violated or verbose:
                print(f"{'VIOLATED' if violated else 'holds'}: {entry}\n    {again}", flush=True)
    except Skip as reason:
        record.skipped[str(reason)] += 1
    except CasswarmWarning as reason:  # where warnings are errors: a plan that is no minimum
        record.skipped[str(reason)] += 1
    except csw.CasswarmError as error:
        record.skipped[type(error).__name__] += 1
        if verbose:
            traceback.print_exc()
    except Exception:
        record.crashes += 1
        print(f"CRASHED: {traceback.format_exc()}    {again}", flush=True)


def search(
    claims: list[str], seed: int, minutes: float = np.inf, draws: float = np.inf
) -> dict[str, Record]:
    """Check the claims in rotation until the time or the number of draws of each is over."""
    records = {claim: Record() for claim in claims}
    end = time.monotonic() + 60 * minutes
    for number in itertools.count():
        for claim in claims:
            if number >= draws or time.monotonic() > end:
                return records
            run_draw(claim, seed + number, records[claim])
    raise AssertionError


def report(records: dict[str, Record]) -> int:
    """Print the counts; return the number of violations."""
    columns = ("part", "checks", "violations", "worst excess", "limit", "coverage")
    rows = [
        (part, tally.checks, tally.violations + tally.covers_too_little)
        + (("", "") if tally.misses is not None else (tally.worst, tally.limit))
        + ("" if tally.coverage is None else tally.coverage,)
        for record in records.values()
        for part, tally in sorted(record.parts.items())
    ]
    print_table(columns, rows)
    columns = ("claim", "draws", "checks", "violations", "exceptions", "skipped")
    rows = []
    for claim, record in records.items():
        skipped = ", ".join(f"{count} {reason}" for reason, count in record.skipped.most_common())
        checks = sum(tally.checks for tally in record.parts.values())
        violations = record.violations - record.crashes
        rows.append((claim, record.draws, checks, violations, record.crashes, skipped))
    print_table(columns, rows)
    return sum(record.violations for record in records.values())


def main() -> int:
    """Search, or replay one draw; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0, help="of the first draw of every claim")
    parser.add_argument("--only", nargs="+", choices=CLAIMS, default=list(CLAIMS))
    parser.add_argument("--replay", nargs=2, metavar=("CLAIM", "SEED"), help="one draw again")
    options = parser.parse_args()
    logging.disable(logging.WARNING)  # failed solves are counted by casswarm
    if options.replay:
        claim, seed = options.replay
        record = Record()
        run_draw(claim, int(seed), record, verbose=True)
        return int(bool(report({claim: record})))
    return int(bool(report(search(options.only, options.seed, options.minutes))))


if __name__ == "__main__":
    sys.exit(main())

"""A fuzzer: mutated scenarios, options, results and records, and studies that are killed.

Run with the installed package, in a checkout::

    python tests/fuzz/fuzz.py --mutations 10000 --kills 100 --seed 0
    python tests/fuzz/fuzz.py --only scenario:17          # one case again
    python tests/fuzz/fuzz.py --only kill:3

A mutation is determined by its kind, number and seed; the moment of a kill only nearly, since it
is a time. Every mutation runs in a process of its own, which may take 60 s of processor time, 300 s
on the clock, and 2 GB more than a case that does nothing. Exits with 1 if a case ended in any other
way than it may: see `targets.fault` and `kills`. Ctrl-C ends the mutations with the counts so far.
Needs a system with fork.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: threads do not survive a fork

import argparse
import shutil
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))

import kills
import samples
import sandbox
import targets

Ended = dict[str, list[tuple[sandbox.Outcome, str]]]
"""How the cases of every kind ended, each with what is wrong."""

ENDS = {targets.ACCEPTED: "accepted", targets.FAILED: "failed", targets.REFUSED: "refused"}


def main() -> int:
    """Run the cases that the arguments ask for, and print how they ended."""
    arguments = parsed()
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        faults = run_mutations(arguments, folder)
        faults += run_kills(arguments, folder)
    finally:
        if arguments.keep:
            print(f"kept in {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)
    print(f"{faults} faults, seed {arguments.seed}", flush=True)
    return 1 if faults else 0


def parsed() -> argparse.Namespace:
    """Arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mutations", type=int, default=0, help="number of mutations")
    parser.add_argument("--kills", type=int, default=0, help="number of kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", metavar="KIND:NUMBER", help="one case again")
    parser.add_argument("--kinds", nargs="+", default=list(targets.KINDS), choices=targets.KINDS)
    parser.add_argument("--quick", action="store_true", help="mutate the results of fewer commands")
    parser.add_argument("--keep", action="store_true", help="keep the files of the last case")
    arguments = parser.parse_args()
    kind = (arguments.only or "").partition(":")[0]
    if arguments.only and kind not in (*targets.KINDS, "kill"):
        parser.error(f"--only {arguments.only}: the kinds are {', '.join(targets.KINDS)}, kill")
    return arguments


# --- mutations


def selected(arguments: argparse.Namespace) -> list[tuple[str, int]]:
    """Kinds and numbers of the mutations."""
    kind, _, number = (arguments.only or "").partition(":")
    if kind:
        return [(kind, int(number))] if kind in targets.KINDS else []
    shares = {kind: targets.KINDS[kind][1] for kind in arguments.kinds}
    scale = arguments.mutations / sum(shares.values())
    counts = {kind: round(share * scale) for kind, share in shares.items()}
    counts[arguments.kinds[0]] += arguments.mutations - sum(counts.values())
    return [(kind, number) for kind, count in counts.items() for number in range(count)]


def run_mutations(arguments: argparse.Namespace, folder: Path) -> int:
    """Run mutations, print a table of them, and return the number of faults."""
    cases = selected(arguments)
    if not cases:
        return 0
    made = folder / "made"
    made.mkdir()
    samples.warm_up()
    prepare(made, {kind for kind, _ in cases}, arguments.quick)
    idle = sandbox.run(lambda: 0, made).peak
    print(f"a case that does nothing needs {idle / 2**20:.0f} MB", flush=True)
    ended: Ended = defaultdict(list)
    with suppress(KeyboardInterrupt):
        end_all(cases, arguments, folder, idle, ended)
    print_table(ended)
    return sum(bool(fault) for outcomes in ended.values() for _, fault in outcomes)


def end_all(
    cases: list[tuple[str, int]],
    arguments: argparse.Namespace,
    folder: Path,
    idle: int,
    ended: Ended,
) -> None:
    """Run cases, add how each ended to `ended`, and report faults."""
    for done, (kind, number) in enumerate(cases):
        if done % 500 == 0:
            print(f"{done} of {len(cases)} mutations", flush=True)
        place = folder / "case"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        case = partial(targets.run, kind, number, arguments.seed, place, folder / "made")
        outcome = sandbox.run(case, place, idle)
        fault = targets.fault(kind, outcome)
        ended[kind].append((outcome, fault))
        if fault or arguments.only:
            report(f"{kind}:{number}", arguments.seed, outcome, fault)


def prepare(made: Path, kinds: set[str], quick: bool) -> None:
    """Make the files that are mutated."""
    commands = list(samples.RESULTS)[: 1 if quick else None]
    samples.csw.save_scenario(samples.SMALL, made / "small.toml")
    jobs = []
    if kinds & {"option", "results"}:
        jobs += [partial(samples.make_results, made, name) for name in commands]
    if kinds & {"record", "cell"}:
        jobs += [partial(samples.make_study, made, name) for name in samples.STUDIES]
    for job in jobs:
        outcome = sandbox.run(job, made, time_limit=600.0, patience=1800.0)
        if outcome.code:
            raise RuntimeError(f"{job} ended with {outcome.code}:\n{outcome.output}")


def report(name: str, seed: int, outcome: sandbox.Outcome, fault: str) -> None:
    """Print how a case ended, and the line that reproduces it."""
    lines = outcome.output.strip().splitlines()
    print(f"{name}: {fault or 'no fault'}; exit code {outcome.code}, {outcome.seconds:.1f} s")
    print("\n".join(f"    {ascii(line[:300])[1:-1]}" for line in lines[:3] + lines[3:][-9:]))
    print(f"    python tests/fuzz/fuzz.py --seed {seed} --only {name}", flush=True)


def print_table(ended: Ended) -> None:
    """Print counts by kind, the slowest case, and the largest peak of memory."""
    header = ("kind", "cases", *ENDS.values(), "faults", "slowest s", "peak MB")
    print("".join(f"{title:>11s}" for title in header))
    for kind, outcomes in ended.items():
        codes = Counter(outcome.code for outcome, fault in outcomes if not fault)
        row = (
            kind,
            len(outcomes),
            *(codes[code] for code in ENDS),
            sum(bool(fault) for _, fault in outcomes),
            f"{max(outcome.seconds for outcome, _ in outcomes):.1f}",
            f"{max(outcome.peak for outcome, _ in outcomes) / 2**20:.0f}",
        )
        print("".join(f"{value!s:>11s}" for value in row), flush=True)


# --- kills


def run_kills(arguments: argparse.Namespace, folder: Path) -> int:
    """Kill and resume studies, print a table, and return the number of faults."""
    kind, _, number = (arguments.only or "").partition(":")
    if kind not in ("", "kill") or not (kind or arguments.kills):
        return 0
    samples.csw.save_scenario(samples.SMALL, folder / "small.toml")
    if kind:
        studies = [kills.killed_study(int(number), arguments.seed, kills.MOST, folder)]
    else:
        studies = list(killed_studies(arguments.kills, arguments.seed, folder))
    for command in kills.STUDIES:
        chosen = [study for study in studies if study.command == command]
        equal = sum(len(study.kills) for study in chosen if not study.faults)
        total = sum(len(study.kills) for study in chosen)
        print(f"{command}: {equal} of {total} kills resumed to equal tables, {len(chosen)} studies")
    return sum(bool(study.faults) for study in studies)


def killed_studies(number: int, seed: int, folder: Path) -> Iterator[kills.Study]:
    """Studies that are killed so many times altogether."""
    done = 0
    for index in count():
        study = kills.killed_study(index, seed, number - done, folder)
        done += len(study.kills)
        state = "; ".join(study.faults) or "equal tables"
        print(f"kill:{index} {study.command}: {', '.join(study.kills)}: {state}", flush=True)
        yield study
        if done >= number:
            return


if __name__ == "__main__":
    sys.exit(main())

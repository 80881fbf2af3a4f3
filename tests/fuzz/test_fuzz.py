"""The fuzzer, on few cases of fixed seeds; the slow test takes more, of a seed that it prints."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


def fuzz(*arguments):
    """Run the fuzzer, and return what it printed."""
    command = [sys.executable, FUZZ, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.mark.slow
def test_mutated_files_and_options_end_as_they_may():
    printed = fuzz("--mutations", 80, "--quick", "--seed", 0)
    assert "0 faults" in printed
    rows = [line.split() for line in printed.splitlines() if line.startswith("   ")]
    cases = {row[0]: list(map(int, row[1:5])) for row in rows[1:]}
    assert sum(row[0] for row in cases.values()) == 80
    for kind in ("scenario", "text", "option", "record"):
        assert cases[kind][1] > 0, "no mutation is accepted"
        assert cases[kind][3] > 0 or kind == "record", "no mutation is refused"


@pytest.mark.slow
def test_killed_study_is_resumed_to_equal_tables():
    assert "sweep: 1 of 1 kills resumed to equal tables" in fuzz("--kills", 1, "--seed", 0)


@pytest.mark.slow
def test_fresh_mutations_and_kills_end_as_they_may():
    seed = random.SystemRandom().randrange(2**32)
    print(fuzz("--mutations", 300, "--kills", 2, "--seed", seed))

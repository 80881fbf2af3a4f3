"""Seeds of studies: one range for all, and streams that no two studies share."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import pytest
from small_scenarios import three_members

from casswarm import Guide, Scenario, estimate, plan, simulate, sweep
from casswarm.chain import required_runs
from casswarm.comparison import compare
from casswarm.reproduction import reproduce
from casswarm.studies.simulation import runs_needed


@cache
def scenario() -> Scenario:
    return three_members(guide__search="local", guide__a_max=0.3)


@cache
def guide() -> Guide:
    return plan(scenario())


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5])
@pytest.mark.parametrize("study", [simulate, runs_needed, estimate, sweep, compare, reproduce])
def test_study_with_seed_out_of_range_raises(study: Any, seed: object) -> None:
    inputs = () if study is reproduce else ("quick",) if study is compare else (scenario(),)
    options = {"settings": {"n": [1]}} if study is sweep else {}
    with pytest.raises(ValueError, match=f"seed = {seed}; allowed: whole numbers from 0 to"):
        study(*inputs, seed=seed, **options)


def test_runs_needed_draws_other_numbers_than_study() -> None:
    of_study = partial(simulate, scenario(), ["leader"], 200, guide=guide())
    needed = partial(runs_needed, scenario(), ["leader"], 0.01, pilot=200, guide=guide())
    successes = [int(of_study(seed=seed).summary["successes"][0]) for seed in range(5)]
    of_studies = [required_runs(0.01, number, 200) for number in successes]
    assert [needed(seed=seed) for seed in range(5)] != of_studies
    assert needed(seed=3) == needed(seed=3)

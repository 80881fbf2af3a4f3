"""Sampling of the chain: runs, equal states, estimates of large swarms, coverage of intervals."""

from __future__ import annotations

import math
from itertools import product
from typing import Any
from unittest import mock

import numpy as np
from _timing import timed

import casswarm as csw
from casswarm.chain import monte_carlo as sampling
from casswarm.chain import states
from casswarm.chain.confidence import effective_runs, stratified_interval, wilson
from casswarm.scenario.variations import with_parameters
from casswarm.studies.simulation import PAPER_POLICIES

Rows = list[dict[str, Any]]


def runs(quick: bool) -> Rows:
    """Three policies on paper-1: 10,000 runs, and 1,000,000, on one process and on two."""
    scenario = csw.load_scenario("paper-1")
    csw.simulate(scenario, runs=100)
    rows = []
    many = 100_000 if quick else 1_000_000
    for number, workers in ((10_000, 1), (many, 1), (many, 2)):
        study, wall, cpu = timed(
            lambda r=number, w=workers: csw.simulate(scenario, runs=r, workers=w)
        )
        rows.append(
            {
                "runs": number,
                "workers": workers,
                "seconds": wall,
                "processor": cpu,
                "states": int(study.effort["states"].sum()),
            }
            | dict(zip(study.summary["policy"], study.summary["success"], strict=True))
        )
    return rows


def every_state(*arrays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As the functions of distinct states would answer if no two were equal."""
    rows = np.arange(len(arrays[0]))
    return rows, rows


def equal(quick: bool) -> Rows:
    """Whether it pays to solve equal states once, in sampling: runs with and without, in turn."""
    number, rows = 2_000 if quick else 20_000, []
    for name in ("paper-1", "paper-2"):
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for policy in PAPER_POLICIES:

            def sample(policy: str = policy, s: Any = scenario, g: Any = guide) -> csw.Study:
                return csw.simulate(s, [policy], number, guide=g, save_trajectories=0)

            sample()
            once, wall, cpu = timed(sample, 3)
            with (
                mock.patch.object(sampling, "distinct_survivors", every_state),
                mock.patch.object(states, "distinct_states", every_state),
            ):
                each, wall_each, cpu_each = timed(sample)
            same = (once.runs["success"] == each.runs["success"]).mean()
            rows.append(
                {
                    "scenario": name,
                    "policy": policy,
                    "runs": number,
                    "states once": int(once.effort["states"][0]),
                    "states each": int(each.effort["states"][0]),
                    "seconds once": wall,
                    "seconds each": wall_each,
                    "processor ratio": cpu_each / cpu,
                    "runs that agree": same,
                }
            )
    return rows


def estimates(quick: bool) -> Rows:
    """Estimates against plain sampling: widths at the same number of solved states."""
    numbers, rows = (100, 500) if quick else (100, 1000, 5000), []
    seeds, swarm = range(3 if quick else 7), csw.load_scenario("large-swarm")
    small = [(csw.load_scenario(n), p) for n in ("paper-1", "paper-2") for p in PAPER_POLICIES[1:]]
    cases = [(*case, number) for case in small for number in numbers]
    cases += [(with_parameters(swarm, {"n": n}), "leader", numbers[1]) for n in (10, 50)]
    for scenario, policy, runs in cases:
        guide = csw.plan(scenario, certify=False)
        results = [
            csw.estimate(scenario, policy, runs, seed, tolerance=1e-4, guide=guide)
            for seed in seeds
        ]
        states = float(np.median([result.states for result in results]))
        more, solved = runs, 0
        while solved < states and more < 60 * numbers[-1]:
            plain = csw.simulate(scenario, [policy], more, guide=guide, save_trajectories=0)
            solved, done = int(plain.effort["states"][0]), more
            more = math.ceil(more * max(1.05, states / solved))
        others = [
            csw.simulate(
                scenario, [policy], done, seed, guide=guide, save_trajectories=0
            ).summary.iloc[0]
            for seed in seeds
        ]
        own = float(np.median([result.success.width for result in results]))
        wide = float(np.median([row.success_high - row.success_low for row in others]))
        width = wide * math.sqrt(solved / states)  # of exactly as many states
        rows.append(
            {
                "scenario": scenario.name,
                "n": scenario.n,
                "policy": policy,
                "runs": runs,
                "sampled mass": results[0].sampled_mass,
                "states": states,
                "width": own,
                "plain runs": done,
                "plain states": solved,
                "plain width": width,
                "ratio": width / own,
            }
        )
    return rows


def coverage(quick: bool) -> Rows:
    """Coverage of 95 % intervals from one run of each of R strata, before and after the fallback.

    The strata's probabilities are equal, rise linearly, or are 0 and 1/2; q is their mean. `wilson`
    is Wilson's interval with the effective runs; `coverage` is that of `stratified_interval`, and
    `width` its mean width relative to the former's. 2000 repetitions (200).
    """
    repetitions, rng, rows = 200 if quick else 2000, np.random.default_rng(1), []
    kinds = {
        "equal": np.full_like,
        "linear": lambda u, q: 2 * q * u,
        "half": lambda u, q: np.where(u > 1 - 2 * q, 0.5, 0.0),
    }
    for number, kind, q in product((50, 100), kinds, (0.005, 0.01, 0.02, 0.05, 0.1, 0.3)):
        chances = kinds[kind]((np.arange(number) + 0.5) / number, q)
        ends = np.empty((repetitions, 4))
        for row, outcomes in zip(ends, rng.random((repetitions, number)) < chances, strict=True):
            effective, successes = effective_runs(outcomes), int(outcomes.sum())
            row[:2] = wilson(successes / number * effective, effective)
            row[2:] = stratified_interval(successes, number, effective)
        covered = (ends[:, ::2] <= chances.mean()) & (chances.mean() <= ends[:, 1::2])
        widths = (ends[:, 1::2] - ends[:, ::2]).mean(axis=0)
        rows.append({"R": number, "strata": kind, "q": q, "wilson": covered[:, 0].mean()})
        rows[-1] |= {"coverage": covered[:, 1].mean(), "width": widths[1] / widths[0]}
    return rows

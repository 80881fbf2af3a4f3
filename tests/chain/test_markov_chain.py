"""The chain as a matrix and as Storm's file, against exact evaluation and Storm itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from small_scenarios import abreast, pair

import casswarm as csw
from casswarm.errors import PolicyError, ScenarioError

Array = NDArray[np.float64]

VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "two-arrivals": {"success": {"arrivals": 2}},
    "late-news": {"information": {"delay": 2}},
    "never-news": {"information": {"delay": "never"}},
    "substeps": {"time": {"substeps": 2}},
}


def varied(name: str) -> csw.Scenario:
    return (abreast(3) if name == "two-arrivals" else pair()).replace(**VARIANTS[name])


def read_drn(path: Path) -> tuple[csr_array, dict[int, tuple[list[float], list[str]]]]:
    """Transitions, and the rewards and labels of every state, of a file."""
    matrix: dict[tuple[int, int], float] = {}
    states: dict[int, tuple[list[float], list[str]]] = {}
    text = path.read_text(encoding="utf-8")
    head, body = text.split("@model\n")
    for line in body.splitlines():
        words = line.replace("[", "").replace("]", "").replace(",", "").split()
        if words[0] == "state":
            state = int(words[1])
            states[state] = [float(word) for word in words[2:4]], words[4:]
        elif words[0] != "action":
            matrix[state, int(words[0])] = float(words[2])
    rows, columns = np.array(list(matrix)).T
    size = int(head.split("@nr_states\n")[1].split()[0])
    return csr_array((list(matrix.values()), (rows, columns)), shape=(size, size)), states


@pytest.mark.parametrize("policy", ["naive", "leader"])
@pytest.mark.parametrize("name", VARIANTS)
def test_chain_has_the_law_of_exact_evaluation(name: str, policy: str) -> None:
    scenario = varied(name)
    chain = csw.markov_chain(scenario, policy, tolerance=0.0)
    law = csw.evaluate(scenario, policy, tolerance=0.0)
    assert not chain.labels["left_out"] @ chain.after(scenario.n_steps)
    assert abs(chain.transitions.sum(axis=1) - 1.0).max() < 1e-14
    arrived = [chain.labels["arrived"] @ chain.after(t) for t in range(scenario.n_steps + 1)]
    assert arrived == pytest.approx(law.arrival.cumsum(), abs=1e-14)
    end = chain.after(scenario.n_steps)
    survivors = [end @ chain.labels[f"survivors_{k}"] for k in range(scenario.n + 1)]
    assert survivors == pytest.approx(law.survivors, abs=1e-14)
    assert chain.success == pytest.approx(law.success, abs=1e-14)
    ends = chain.labels["arrived"] | chain.labels["late"] | chain.labels["lost"]
    assert end @ ends == pytest.approx(1.0, abs=1e-14)


@pytest.mark.slow
def test_left_out_histories_widen_bounds() -> None:
    scenario = csw.load_scenario("barricade")
    exact = csw.evaluate(scenario, "leader", tolerance=1e-9)
    chain = csw.markov_chain(scenario, "leader", tolerance=0.02)
    end = chain.after(scenario.n_steps)
    low, high = chain.success
    assert 0.0 < end @ chain.labels["left_out"] <= 0.02
    assert low <= exact.success.low + 1e-9
    assert exact.success.high <= high + 1e-9
    assert high - low == pytest.approx(end @ chain.labels["left_out"])
    few = csw.markov_chain(scenario, "leader", tolerance=0.0, max_states=50)
    assert (few.steps >= 0).sum() <= 50
    assert few.success.low <= exact.success.low + 1e-9
    assert exact.success.high <= few.success.high + 1e-9


def test_states_are_those_of_the_swarm() -> None:
    scenario = pair()
    chain = csw.markov_chain(scenario, "naive", tolerance=0.0)
    ends = chain.steps < 0
    assert chain.positions[0] == pytest.approx(scenario.positions)
    assert chain.alive[0].all()
    assert not chain.alive[ends].any()
    assert chain.alive[~ends].any(axis=1).all()
    rows, columns = chain.transitions.nonzero()
    swarm = ~ends[rows]
    later = np.where(ends[columns], chain.steps[rows] + 1, chain.steps[columns])
    assert (later == chain.steps[rows] + 1)[swarm].all()
    assert (rows == columns)[~swarm].all()
    both = swarm & ~ends[columns]
    assert (chain.alive[columns] <= chain.alive[rows])[both].all()
    assert "MarkovChain(" in repr(chain)


def test_file_has_every_digit(tmp_path: Path) -> None:
    chain = csw.markov_chain(csw.load_scenario("paper-1"), "constrained", tolerance=0.01)
    path = chain.export(tmp_path / "chain.drn")
    matrix, states = read_drn(path)
    assert abs(matrix - chain.transitions).max() == 0.0
    assert states[0] == ([1.0, 5.0], ["init"])
    for state, (rewards, labels) in states.items():
        assert rewards == [chain.steps[state] >= 0, chain.alive[state].sum()]
        marked = [name for name, where in chain.labels.items() if where[state]]
        assert labels == (["init"] if state == 0 else []) + marked


def test_swarms_that_are_too_large_and_unknown_hazards_are_refused() -> None:
    with pytest.raises(PolicyError, match="chains are for at most 12, "):
        csw.markov_chain(csw.load_scenario("large-swarm"), "leader")
    with pytest.raises(ScenarioError, match=r"hazard\.case"):
        csw.markov_chain(csw.load_scenario("two-gaps"), "leader")
    with pytest.raises(ValueError, match="tolerance = 1"):
        csw.markov_chain(pair(), "leader", tolerance=1.0)


def test_storm_agrees_in_twenty_queries(tmp_path: Path) -> None:
    stormpy = pytest.importorskip("stormpy")
    scenario = csw.load_scenario("paper-1")
    chain = csw.markov_chain(scenario, "leader", tolerance=1e-6)
    steps, path = scenario.n_steps, chain.export(tmp_path / "chain.drn")
    end, ends = chain.after(steps), '("arrived" | "late" | "lost" | "left_out")'
    arrived, alive = chain.labels["arrived"], chain.alive.sum(axis=1)
    expected = {f'P=? [F "{name}"]': end @ chain.labels[name] for name in chain.labels}
    for t in (5, 20, 28, 29, 30):
        expected[f'P=? [F<={t} "arrived"]'] = chain.after(t) @ arrived
    for k in (1, 3):
        both = arrived & chain.labels[f"survivors_{k}"]
        expected[f'P=? [F ("arrived" & "survivors_{k}")]'] = end @ both
    going = [chain.after(t) @ (chain.steps >= 0) for t in range(steps)]
    expected[f'R{{"steps"}}=? [F {ends}]'] = np.sum(going)
    expected['R{"alive"}=? [I=7]'] = chain.after(7) @ alive
    expected['R{"alive"}=? [C<=12]'] = sum(chain.after(t) @ alive for t in range(12))
    assert len(expected) >= 20
    model = stormpy.build_model_from_drn(str(path))
    for query, value in expected.items():
        (formula,) = stormpy.parse_properties(query)
        result = stormpy.model_checking(model, formula)
        assert result.get_value(model.initial_states[0]) == pytest.approx(value, abs=1e-10), query

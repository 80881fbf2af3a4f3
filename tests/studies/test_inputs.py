"""A study belongs to the code of the user that it calls, too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from small_scenarios import small

from casswarm import Scenario, load_scenario, save_scenario, simulate, sweep
from casswarm._util.user_code import load
from casswarm.errors import CheckpointError

POLICY = "def stay(step, positions, previous_velocities, alive):\n    return {} * positions\n"
RATE = "def rate(positions, alive):\n    return {} * alive\n"


def scenario() -> Scenario:
    return small([(0.0, 0.0)], (1.0, 0.0), [(1.5, 0.8)], 4, guide__search="local")


def simulated(scenario: Scenario, policy: Any, folder: Path) -> None:
    simulate(scenario, [policy], 5, checkpoint=folder, if_exists="resume")


def swept(scenario: Scenario, policy: Any, folder: Path) -> None:
    settings = {"formation.rho": [0.1]}
    sweep(scenario, settings, [policy], checkpoint=folder, if_exists="resume")


@pytest.mark.parametrize("study", [simulated, swept])
def test_study_with_changed_policy_is_not_resumed(tmp_path: Path, study: Any) -> None:
    for number, factor in enumerate((0.0, 0.0, 0.1)):
        folder = tmp_path / str(number)  # a process imports a file once
        folder.mkdir()
        (folder / "mine.py").write_text(POLICY.format(factor))
        policy = load("mine:stay", folder)
        if factor:
            with pytest.raises(CheckpointError, match=r"belongs to other inputs:\n  code\.stay: "):
                study(scenario(), policy, tmp_path / "results")
        else:
            study(scenario(), policy, tmp_path / "results")


def test_study_with_changed_rates_is_not_resumed(tmp_path: Path) -> None:
    for number, rate in enumerate((0.1, 0.1, 0.2)):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "mine.py").write_text(RATE.format(rate))
        path = folder / "mine.toml"
        save_scenario(scenario(), path)
        text = path.read_text()
        start, end = text.index("[hazard]"), text.index("[guide]")
        path.write_text(f'{text[:start]}[hazard]\nkind = "mine:rate"\n\n{text[end:]}')
        own = load_scenario(path, allow_code=True)
        if rate > 0.1:
            with pytest.raises(CheckpointError, match=r"code\.hazard: "):
                simulated(own, "leader", tmp_path / "results")
        else:
            simulated(own, "leader", tmp_path / "results")

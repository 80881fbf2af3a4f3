"""Sweeps of unusual inputs: each does what it says, or says what is wrong."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import casswarm as csw
from casswarm._util.checkpoint import Checkpoint
from casswarm.chain.exact import _next_threshold
from casswarm.cli.common import WrongInput
from casswarm.cli.sweep import _values
from casswarm.errors import CheckpointError, PolicyError
from casswarm.scenario.variations import whole_numbers, with_parameters

SMALL = csw.load_scenario("paper-1").with_values(
    {
        "swarm.positions": [[0.0, 0.0], [0.5, 0.0]],
        "time.t_f": 2.0,
        "target.center": [2.0, 0.5],
        "hazard.alpha_1": 20.0,
    }
)


def swept(settings: dict[str, Any], **options: Any) -> pd.DataFrame:
    return csw.sweep(SMALL, settings, ["leader"], **({"tolerance": 0.1} | options)).table


def test_sweep_with_reordered_parameters_is_not_resumed(tmp_path: Path) -> None:
    swept({"n": [1, 2], "formation.rho": [0.02, 0.1]}, checkpoint=tmp_path)
    with pytest.raises(CheckpointError, match="keys"):
        swept({"formation.rho": [0.02, 0.1], "n": [1, 2]}, checkpoint=tmp_path, if_exists="resume")


def test_sweep_accepts_numpy_numbers(tmp_path: Path) -> None:
    table = swept({"n": np.arange(1, 3)}, runs=np.int64(5), checkpoint=tmp_path)
    assert table["status"].tolist() == ["ok", "ok"]
    assert table["n"].tolist() == [1, 2]


@pytest.mark.parametrize("policies", [[], ["leader", "leader"]])
def test_sweep_without_distinct_policies_raises(policies: Any) -> None:
    with pytest.raises(PolicyError, match="polic"):
        csw.sweep(SMALL, {"n": [1]}, policies)


def test_sweep_accepts_single_policy() -> None:
    table = csw.sweep(SMALL, {"n": [1]}, "naive", runs=2).table
    assert table["policy"].tolist() == ["naive"]
    columns = ["success", "success_low", "success_high"]
    assert [name for name in table.columns if name in columns] == columns


def test_resumed_sweep_repeats_failed_points(tmp_path: Path) -> None:
    settings = {"formation.rho": [0.05, -1.0]}
    first = swept(settings, checkpoint=tmp_path)
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "checkpoint").glob("*.npz")}
    again = swept(settings, checkpoint=tmp_path, if_exists="resume")
    assert first["status"].tolist() == again["status"].tolist() == ["ok", "failed"]
    now = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "checkpoint").glob("*.npz")}
    assert [now[name] == kept[name] for name in sorted(kept)] == [True, False]


def test_sweep_point_with_wide_bounds_has_reason() -> None:
    table = swept({"n": [2]}, tolerance=1e-9, max_states=2)
    assert table["status"].tolist() == ["ok"]
    assert "state budget exhausted" in table["reason"][0]
    assert swept({"n": [2]})["reason"].tolist() == [""]


def test_sweep_adds_members_to_coincident_ones() -> None:
    crowd = SMALL.with_values({"swarm.positions": [[1.0, 1.0], [1.0, 1.0]]})
    positions = with_parameters(crowd, {"n": 5}).positions
    assert positions.shape == (5, 2)


def test_sweep_command_ranges_of_integers_are_integers() -> None:
    assert _values("formation.iterations=500:2000:4") == (
        "formation.iterations",
        [500, 1000, 1500, 2000],
    )
    assert _values("hazard.alpha_2=1.0:3:3") == ("hazard.alpha_2", [1.0, 2.0, 3.0])
    assert all(type(n) is int for n in _values("n=1:6:6:linear")[1])


@pytest.mark.parametrize(
    ("setting", "advice"),
    [
        (
            "n=1:3:6",
            "n takes whole numbers, not 1.4; choose a COUNT that gives whole numbers, such",
        ),
        ("n=1:3:6", "such as n=1:3:3, or list the numbers, n=V1,V2,..."),
        ("n=1:7:5", "such as n=1:7:4,"),
        ("n=0.5:3:2", "n takes whole numbers, not 0.5"),
        ("guide.iterations=1:2:3", "guide.iterations takes whole numbers, not 1.5"),
        ("formation.rho=inf:1:3", "START and STOP are finite numbers"),
        ("formation.rho=0.1:nan:3", "START and STOP are finite numbers"),
        ("formation.rho=0.1:0.2:1000000000000", "COUNT is a whole number from 1 to 1000"),
    ],
)
def test_sweep_command_refuses_ranges_that_no_scenario_has(setting: str, advice: str) -> None:
    with pytest.raises(WrongInput) as caught:
        _values(setting)
    assert advice in str(caught.value)


def test_sweep_of_whole_numbers_takes_no_fractions() -> None:
    assert _values("n=1.0:3.0:3") == ("n", [1, 2, 3])
    assert all(type(n) is int for n in whole_numbers("n", np.linspace(1, 2, 2)))
    for key in ("n", "guide.iterations"):
        with pytest.raises(csw.ScenarioError, match=f"{key} takes whole numbers, not 1.5"):
            csw.sweep(SMALL, {key: [1, 1.5]})


def test_sweep_jobs_in_threads_take_turns() -> None:
    """CasADi's functions must not be shared by threads that run."""
    settings = {"hazard.alpha_1": [5.0, 10.0, 15.0, 20.0]}
    with ThreadPoolExecutor(4) as pool:
        threaded = swept(settings, workers=pool)
    pd.testing.assert_frame_equal(threaded, swept(settings))


@pytest.mark.parametrize("choice", ["error", "resume", "overwrite"])
def test_checkpoint_keeps_foreign_files(tmp_path: Path, choice: Any) -> None:
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "checkpoint" / "thesis.tex").write_text("years of work")
    with (
        pytest.raises(CheckpointError, match=r"thesis\.tex"),
        Checkpoint(tmp_path, {"runs": 1}, choice),
    ):
        pass
    assert (tmp_path / "checkpoint" / "thesis.tex").read_text() == "years of work"


def test_checkpoint_keeps_records_with_lost_inputs(tmp_path: Path) -> None:
    with Checkpoint(tmp_path, {"runs": 1}) as store:
        store.save("one", {"x": np.zeros(1)})
    (tmp_path / "checkpoint" / "inputs.json").write_text("{")
    for choice in ("error", "resume"):
        with (
            pytest.raises(CheckpointError, match="--overwrite"),
            Checkpoint(tmp_path, {"runs": 1}, choice),
        ):
            pass
    with Checkpoint(tmp_path, {"runs": 1}, if_exists="overwrite") as store:
        assert store.names() == []


def test_evaluate_ends_when_all_states_are_expanded() -> None:
    """Budgets and tolerances around the place where every state has been followed."""
    for max_states in (20, 60, 200, 600):
        law = csw.evaluate(SMALL, "leader", 1e-7, max_states=max_states)
        low, high = law.success
        assert low <= high
    assert law.complete
    assert _next_threshold([(1e-2, 0.1, 10), (1e-3, 0.01, 30)], 1e-4, 1000) < 1e-3

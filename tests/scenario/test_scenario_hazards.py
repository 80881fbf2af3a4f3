"""Hazards of scenarios: built-in kinds, functions and classes of users."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import pytest
from scenario_messages import message

from casswarm.hazard import CustomHazard, KernelHazard
from casswarm.scenario import Scenario, load_scenario, save_scenario


def constant_rate(positions: Any, alive: Any, rate: float = 0.1) -> Any:  # noqa: ARG001
    return 0 * positions[:, 0] + rate


def negative_rate(positions: Any, alive: Any) -> Any:  # noqa: ARG001
    return 0 * positions[:, 0] - 1


# --- functions of the user's own


def test_hazard_function_of_module_is_stored_by_name(paper: Scenario, tmp_path: Path) -> None:
    scenario = paper.with_hazard(constant_rate, rate=0.25)
    assert isinstance(scenario.hazard, CustomHazard)
    assert scenario.hazard.rates(scenario.positions).tolist() == [0.25] * 5
    assert scenario.hazard_table.kind == f"{__name__}:constant_rate"
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    save_scenario(scenario, tmp_path / "custom.toml")
    text = "def constant_rate(positions, alive, rate):\n    return 0 * positions[:, 0] + rate\n"
    (tmp_path / f"{__name__}.py").write_text(text)
    assert load_scenario(tmp_path / "custom.toml", allow_code=True) == scenario
    assert scenario.with_values({"hazard.parameters.rate": 1}).hazard.rates([[0, 0]]) == [1]


def test_hazard_lambda_works_but_cannot_be_saved(paper: Scenario, tmp_path: Path) -> None:
    scenario = paper.with_hazard(lambda positions, alive: positions[:, 0] ** 2 * alive)
    assert scenario.hazard.rates([[3, 0]]).tolist() == [9]
    assert scenario.with_values({"formation.rho": 1}).hazard == scenario.hazard
    text = message(save_scenario, scenario, tmp_path / "custom.toml")
    assert "scenario 'paper-1' cannot be saved: hazard.kind is a function" in text
    assert "is a lambda; move it into a module" in text
    assert not (tmp_path / "custom.toml").exists()


def test_hazard_function_without_name_reports_reason(
    paper: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Rate:
        def __call__(self, positions: Any, alive: Any) -> Any:
            return constant_rate(positions, alive)

    assert "has no name" in message(paper.with_hazard(Rate()).to_toml)

    def other(positions: Any, alive: Any) -> Any:
        return constant_rate(positions, alive)

    for name, module, reason in [
        ("constant_rate", __name__, "is not this function"),
        ("gone", __name__, "cannot be imported"),
        ("other", "__main__", "is defined in a script or notebook"),
    ]:
        monkeypatch.setattr(other, "__qualname__", name)
        monkeypatch.setattr(other, "__module__", module)
        assert reason in message(paper.with_hazard(other).to_toml)


def test_hazard_module_beside_file_is_imported_with_consent(
    file: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / "beside_the_file.py").write_text(
        "import pathlib\n"
        "pathlib.Path(__file__).with_name('was_run').touch()\n"
        "def rate(positions, alive, scale, radars):\n"
        "    x, y = radars[0]\n"
        "    return scale[1] * ((positions[:, 0] - x) ** 2 + (positions[:, 1] - y) ** 2)\n"
    )
    path = file()
    text = path.read_text()
    start, end = text.index("[hazard]"), text.index("[guide]")
    table = (
        '[hazard]\nkind = "beside_the_file:rate"\nradars = [[3, 4]]\nparameters.scale = [0, 2]\n\n'
    )
    path.write_text(text[:start] + table + text[end:])
    words = message(load_scenario, path)
    assert f"hazard.kind is 'beside_the_file:rate', which is code in {tmp_path}" in words
    assert "--allow-code" in words
    assert "load_scenario(..., allow_code=True)" in words
    assert not (tmp_path / "was_run").exists()
    scenario = load_scenario(path, allow_code=True)
    assert (tmp_path / "was_run").exists()
    assert scenario.hazard.rates([[0, 0]]).tolist() == [50]
    for other in (
        pickle.loads(pickle.dumps(scenario)),
        scenario.with_values({"swarm.a_max": 2.0}),
        copy.deepcopy(scenario),
    ):
        assert other.hazard.rates([[0, 0]]).tolist() == [50]


def test_failing_hazard_names_file_and_key(file: Callable[..., Path]) -> None:
    path = file(('"saturation"', f'"{__name__}:constant_rate"'))
    text = message(load_scenario, path)
    assert f"scenario file {path} is invalid:" in text
    assert "hazard.alpha_1 is not a key of a 'module:function' kind; write it as" in text
    assert "hazard.parameters.alpha_1" in text
    for kind, reason in [
        ("no_such_module:rate", "cannot import the module 'no_such_module'"),
        (f"{__name__}:no_such_rate", "has no function 'no_such_rate'"),
        (f"{__name__}:negative_rate", "must be finite and not negative"),
    ]:
        paper = load_scenario("paper-1")
        text = message(paper.with_hazard, kind)
        assert f"hazard.kind is '{kind}': " in text
        assert reason in text


def test_hazard_parameters_must_be_plain_values(paper: Scenario) -> None:
    text = message(paper.with_hazard, constant_rate, rate=object(), alive=1)
    assert "hazard.parameters.rate is <object object" in text
    assert "must be a table of numbers, texts, true or false, or lists of these" in text
    assert "hazard.parameters.alive is reserved" in text
    assert "hazard.parameters.rate is nan" in message(
        paper.with_hazard, constant_rate, rate=math.nan
    )


# --- hazard tables


@pytest.mark.parametrize("kind", ["saturation", "saturation+collision"])
def test_core_radius_is_a_fiftieth_of_target_radius_by_default(kind: str) -> None:
    paper = load_scenario("paper-2" if "collision" in kind else "paper-1")
    assert paper.hazard.core_radius == 0.01
    assert paper.with_values({"target.radius": 0.2}).hazard.core_radius == pytest.approx(0.004)
    given = paper.with_values({"hazard.core_radius": 0.3})
    assert given.hazard.core_radius == 0.3
    assert given.hazard != paper.hazard
    one = [s.with_values({"hazard.radars": [[6.0, 2.0]]}) for s in (paper, given)]
    peaks = [s.hazard.rates([[6.0, 2.0]])[0] for s in one]
    assert peaks[0] == pytest.approx(900 * peaks[1])


@pytest.mark.parametrize("key", ["alpha_1", "alpha_2", "alpha_3", "beta_1", "beta_2"])
def test_missing_hazard_constant_is_named(key: str) -> None:
    text = message(load_scenario("paper-2").with_values, {f"hazard.{key}": None})
    assert f"hazard.{key} is missing; kind 'saturation+collision' needs it: a number" in text


def test_overflowing_collision_rate_is_refused() -> None:
    text = message(load_scenario("paper-2").with_values, {"hazard.beta_2": 1000})
    assert "hazard.beta_2 is 1000 with beta_1 = 0.2: the rate of members that touch exceeds" in text


# --- classes of the user's own


@dataclass(frozen=True)
class Gaussian(KernelHazard):
    height: float = 1.0

    def source(self, squared_distance: Any) -> Any:
        return self.height * ca.exp(-squared_distance)

    def density(self, squared_distance: Any) -> Any:
        return 0 * squared_distance

    def collision(self, squared_distance: Any) -> Any:
        return 0 * squared_distance

    def combine(self, source: Any, density: Any, collision: Any) -> Any:
        return source + density + collision


def test_hazard_class_gets_radars_and_parameters(paper: Scenario, tmp_path: Path) -> None:
    scenario = paper.with_hazard(Gaussian, radars=[(3, 4)], height=0.5, strengths=[2.0])
    assert scenario.hazard == Gaussian(radars=((3.0, 4.0),), strengths=(2.0,), height=0.5)
    assert scenario.hazard.rates([[3.0, 4.0]]).tolist() == [1.0]
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    save_scenario(scenario, tmp_path / "kernels.toml")
    (tmp_path / f"{__name__}.py").write_text(f"from {__name__} import Gaussian\n")
    loaded = load_scenario(tmp_path / "kernels.toml", allow_code=True)
    assert loaded.hazard == scenario.hazard  # a class derived from Hazard may be imported there


def test_failing_hazard_class_reports_reason(paper: Scenario) -> None:
    text = message(paper.with_hazard, Gaussian, radars=[(3, 4)], width=2.0)
    assert "Gaussian cannot be made" in text
    assert "width" in text
    assert "radars are empty" in message(paper.with_hazard, Gaussian)

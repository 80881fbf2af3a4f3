"""Hazards that a scenario names: where their code is looked for, and what is not run."""

from __future__ import annotations

import pickle
import py_compile
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from commands import python
from refusals import refused

import casswarm.hazard.custom
from casswarm.errors import HazardError
from casswarm.hazard import CustomHazard, Hazard
from casswarm.hazard.custom import origin, user_hazard

HERE = __name__
UNIT = "def rate(positions, alive):\n    return {} * alive\n"


def rate_by_name(positions: Any, alive: Any, scale: float = 1.0) -> Any:  # noqa: ARG001
    return scale * positions[:, 1]


not_a_function = 3


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    return path


def rates_of(hazard: Hazard) -> Any:
    return hazard.rates([[0.0, 0.0]]).tolist()


# --- from a caller


def test_function_is_imported_by_name() -> None:
    hazard = user_hazard(f"{__name__}:rate_by_name", None, (), {"scale": 2})
    assert hazard == CustomHazard(rate_by_name, (), {"scale": 2})


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rate_by_name", "'rate_by_name' is not of the form 'module:function'"),
        (":rate_by_name", "':rate_by_name' is not of the form 'module:function'"),
        ("module:", "'module:' is not of the form 'module:function'"),
        (
            "no_such_module:rate",
            "cannot import the module 'no_such_module' of 'no_such_module:rate': "
            "ModuleNotFoundError: No module named 'no_such_module'",
        ),
        (f"{HERE}:none", f"the module '{HERE}' has no function 'none'"),
        (f"{HERE}:rate_by_name.none", f"the module '{HERE}' has no function 'rate_by_name.none'"),
        (f"{HERE}:not_a_function", f"'{HERE}:not_a_function' is not a function"),
    ],
)
def test_wrong_name_names_the_missing_part(name: str, words: str) -> None:
    assert refused(user_hazard, name, None, (), {}) == words


# --- from the folder of a file


def test_method_is_loaded_from_folder_and_sys_path_is_unchanged(tmp_path: Path) -> None:
    before = [*sys.path]
    text = "class Rates:\n  @staticmethod\n  def unit(positions, alive):\n    return alive\n"
    write(tmp_path / "found_in_folder.py", text)
    hazard = user_hazard("found_in_folder:Rates.unit", tmp_path, (), {})
    assert hazard.rates([[0, 0], [1, 1]]).tolist() == [1, 1]
    assert sys.path == before
    assert "found_in_folder" not in sys.modules


def test_modules_of_one_name_in_two_folders_are_two_modules(tmp_path: Path) -> None:
    for folder in ("1", "2"):
        write(tmp_path / folder / "twin.py", UNIT.format(folder))
    found = [user_hazard("twin:rate", tmp_path / folder, (), {}) for folder in ("1", "2")]
    assert [rates_of(hazard) for hazard in found] == [[1.0], [2.0]]


def test_module_named_as_one_of_the_standard_library_hides_nothing(tmp_path: Path) -> None:
    write(tmp_path / "html.py", UNIT.format(3))
    assert rates_of(user_hazard("html:rate", tmp_path, (), {})) == [3.0]
    import html

    assert html.escape("<") == "&lt;"


def test_package_and_relative_import_are_found(tmp_path: Path) -> None:
    write(tmp_path / "pack" / "__init__.py", "from .inner import rate\n")
    write(tmp_path / "pack" / "inner.py", UNIT.format(4))
    write(tmp_path / "beside.py", "from .pack import inner\n\n\nrate = inner.rate\n")
    for name in ("pack:rate", "pack.inner:rate", "beside:rate"):
        assert rates_of(user_hazard(name, tmp_path, (), {})) == [4.0]


def test_compiled_code_beside_the_text_is_not_run(tmp_path: Path) -> None:
    shown = write(tmp_path / "shown.py", UNIT.format(6))
    hidden = write(tmp_path / "hidden" / "shown.py", UNIT.format(7))
    for cached in (f"__pycache__/shown.{sys.implementation.cache_tag}.pyc", "shown.pyc"):
        (tmp_path / cached).parent.mkdir(exist_ok=True)
        mode = py_compile.PycInvalidationMode.UNCHECKED_HASH
        py_compile.compile(str(hidden), str(tmp_path / cached), invalidation_mode=mode)
    write(tmp_path / f"shown.cpython-{sys.version_info[0]}{sys.version_info[1]}.so", "no library")
    assert origin("shown:rate", tmp_path) == str(shown)
    assert rates_of(user_hazard("shown:rate", tmp_path, (), {})) == [6.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 / 0\n", "ZeroDivisionError: division by zero"),
        ("import sys\nsys.exit()\n", "SystemExit: "),
        ("import no_such_helper\n", "ModuleNotFoundError: No module named 'no_such_helper'"),
        ("import sibling\n", "ModuleNotFoundError: No module named 'sibling' ("),
        ("from . import no_such_helper\n", "ImportError: cannot import name 'no_such_helper'"),
    ],
)
def test_module_that_fails_to_import_is_explained(tmp_path: Path, text: str, words: str) -> None:
    write(tmp_path / "broken.py", text)
    write(tmp_path / "sibling.py", "")
    said = refused(user_hazard, "broken:rate", tmp_path, (), {})
    assert said.startswith(f"cannot import the module 'broken' of 'broken:rate': {words}")
    assert "casswarm_user" not in said
    assert ("write `from . import sibling`" in said) == (text == "import sibling\n")


@pytest.mark.parametrize(
    "line", ["from webbrowser import open as rate", "from os import system as rate"]
)
def test_function_that_the_module_only_imports_is_refused(tmp_path: Path, line: str) -> None:
    write(tmp_path / "borrowed.py", f"{line}\n")
    assert "is not defined in the folder" in refused(user_hazard, "borrowed:rate", tmp_path, (), {})


@pytest.mark.parametrize("name", ["click:edit", "webbrowser:open", "os:system", "builtins:print"])
def test_file_cannot_name_installed_code(tmp_path: Path, name: str) -> None:
    with pytest.raises(HazardError, match=r"there is no file .*, and no installed package offers"):
        user_hazard(name, tmp_path, (), {})
    assert origin(name, tmp_path) is None


def test_entry_point_of_installed_package_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"{__name__}:rate_by_name"
    offered = EntryPoint("height", name, casswarm.hazard.custom.ENTRY_POINTS)
    monkeypatch.setattr(
        casswarm.hazard.custom, "entry_points", lambda group: [offered] if group else []
    )
    assert user_hazard(name, tmp_path, (), {}) == CustomHazard(rate_by_name)
    assert "entry point 'height'" in str(origin(name, tmp_path))


def test_function_of_folder_pickles_into_another_process(tmp_path: Path) -> None:
    write(tmp_path / "sent.py", UNIT.format(8))
    hazard = user_hazard("sent:rate", tmp_path, (), {})
    assert isinstance(hazard, CustomHazard)
    (tmp_path / "function.pickle").write_bytes(pickle.dumps(hazard.function))
    program = "import pickle, pathlib\n"
    program += "function = pickle.loads(pathlib.Path('function.pickle').read_bytes())\n"
    program += "print(function([[0, 0]], 1))"
    assert python("-c", f"import casswarm\n{program}", folder=tmp_path).stdout.strip() == "8"

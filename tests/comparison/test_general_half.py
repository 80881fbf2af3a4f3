"""Programs, solvers and their comparison are of use without swarms, and then import none."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import python

from casswarm.comparison import FAMILIES, Family, register_problems
from casswarm.errors import ComparisonError
from casswarm.nlp import LagrangianHessian, Nlp

EXAMPLE = Path(__file__).parents[2] / "docs/examples/chemical_equilibrium.py"
SWARMS = ("scenario", "hazard", "formation", "motion", "studies", "figures", "problems")
CHECK = """
import runpy, sys
if __name__ == "__main__":
    example = runpy.run_path({path!r}, run_name="example")
    {run}
    loaded = {{name.split(".")[1] for name in sys.modules if name.startswith("casswarm.")}}
    print("swarms:", sorted(loaded & {rooms!r}))
"""


def printed(run: str, folder: Path) -> list[str]:
    """Lines that a fresh process prints, which runs a line of code with `example`."""
    script = folder / "script.py"
    script.write_text(CHECK.format(path=str(EXAMPLE), run=run, rooms=set(SWARMS)))
    return python(script).stdout.splitlines()


def test_batch_of_another_field_imports_no_swarm(tmp_path: Path) -> None:
    run = (
        "instances = example['mixtures'](example['np'].array([51.0]), example['np'].ones(1)); "
        "solver = example['solvers'].make_solver('interior-point'); "
        "print(solver.solve_batch(example['equilibrium'](), instances).objective.round(4))"
    )
    assert printed(run, tmp_path) == ["[-47.7611]", "swarms: []"]


@pytest.mark.slow
def test_comparison_of_another_field_imports_no_swarm(tmp_path: Path) -> None:
    first, second, *rows, last = printed("example['main']()", tmp_path)
    assert first == "published mixture: energy -47.7611"  # Hock and Schittkowski's optimum
    assert second == "1000 of 1000 mixtures solved"
    assert [row.split() for row in rows[1:]] == [
        [name, "1.0", "1.0"] for name in ("interior-point", "ipopt", "sqp")
    ]
    assert last == "swarms: []"


def test_families_are_registered_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FAMILIES, "targets", dict(FAMILIES.targets))
    register_problems("quick", FAMILIES.targets["quick"])  # again, which changes nothing
    assert list(FAMILIES) == ["guides", "formations", "quick"]
    register_problems("mine", f"{__name__}:MINE")
    assert FAMILIES["mine"] is MINE
    with pytest.raises(ComparisonError, match=r"family 'mine' is .*MINE already; got other"):
        register_problems("mine", "other:MINE")


MINE = Family(lambda _count, _seed: iter(()), 1)


def test_attachments_are_found_by_type_and_replaced() -> None:
    program = Nlp("empty", {}, {}, 0.0, {})
    first, second = LagrangianHessian(1), LagrangianHessian(2)
    assert program.attached(LagrangianHessian) is None
    assert program.with_attachments(first, "text").attached(LagrangianHessian) is first
    again = program.with_attachments(first, "text").with_attachments(second)
    assert again.attachments == ("text", second)
    assert again.attached(int) is None

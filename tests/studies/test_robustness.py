"""What goes wrong is caught where it happens: faulty backends, policies, guides and workers."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from commands import python

import casswarm as csw
from casswarm.errors import PlanningError
from casswarm.formation import Auto, SpectralProjectedGradient
from casswarm.formation.objective import formation_objective
from casswarm.formation.spectral_kernels import CONVERGED
from casswarm.guide import plan_from
from casswarm.hazard import KernelHazard
from casswarm.nlp import Status
from casswarm.solvers import Answer, Solver

PAPER = csw.load_scenario("paper-1")
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class NotANumber(Solver):
    """A backend that answers NaN, and calls it solved."""

    name: ClassVar[str] = "nan"
    summary: ClassVar[str] = "answers NaN"

    def prepare(self, nlp):
        """Nothing."""

    def run(self, nlp, instances):
        nothing = np.full(nlp.sizes[0], np.nan)
        return [Answer(nothing, Status.SOLVED, "fine", 0, 0, 0.0) for _ in range(len(instances))]


def test_plan_with_nan_answers_raises():
    with pytest.raises(PlanningError, match=r"1 failed"):
        csw.plan(PAPER, NotANumber())
    guide = csw.plan(PAPER, NotANumber(), check=False)
    assert not guide.arrives
    assert guide.solution.status is Status.FAILED


def test_simulate_counts_nan_answers_as_failures():
    guide = csw.plan(PAPER)
    study = csw.simulate(PAPER, ["leader"], 20, guide=guide, solver=NotANumber())
    runs = study.runs
    assert (runs["solver_failures"] > 0).all()
    assert (runs["solver_failures"] <= runs["steps"]).all()


@dataclass(frozen=True)
class Hasty(SpectralProjectedGradient):
    """A batch solver that stops after an iteration, and calls what it has solved."""

    def run_batch(self, nlp, instances):
        run = SpectralProjectedGradient(max_iter=1).run_batch(nlp, instances)
        run.results.outcome[:] = CONVERGED
        return run


@pytest.mark.slow
def test_auto_verifies_answers_of_batch_solver():
    guide = csw.plan(PAPER)
    honest, lied_to = (
        csw.simulate(PAPER, ["constrained"], 40, guide=guide, solver=solver).runs
        for solver in (Auto(), Auto(batch=Hasty()))
    )
    assert lied_to["fallbacks"].sum() > 100
    assert (lied_to["success"] == honest["success"]).all()


@pytest.mark.slow
def test_naive_member_without_guide_steers_at_target():
    far = PAPER.with_values({"swarm.positions": [[0.0, 0.0], [0.1, 0.0], [-30.0, -30.0]]})
    assert not plan_from(far, (-30.0, -30.0)).arrives
    study = csw.simulate(far, ["naive"], 20)
    assert (study.runs["solver_failures"] > 0).all()


@pytest.mark.slow
def test_naive_member_guides_use_search_of_guide():
    scenario = PAPER.with_values({"guide.arrival": "any"})
    guide = csw.plan(scenario, search="global")
    own = csw.make_policy("naive", scenario, guide).guides
    assert {g.search for g in own} == {"global"}
    assert min(g.survival for g in own) > 0.8 * guide.survival


def test_projected_gradient_of_global_scenario_searches_locally():
    quick = PAPER.with_values({"guide.search": "global", "guide.iterations": 5})
    assert csw.plan(quick, "projected-gradient", check=False).search == "local"


@dataclass(frozen=True)
class Branching(KernelHazard):
    """Kernels that branch on a number of theirs, which symbols cannot do."""

    sharp: float = 2.0

    def source(self, squared_distance):
        power = 1 if self.sharp > 1 else 2
        return 1 / (1 + squared_distance) ** power

    def density(self, squared_distance):
        return 1 / (1 + squared_distance)

    def collision(self, squared_distance):
        return 0 * squared_distance

    def combine(self, source, density, collision):
        return source / (1 + density) + collision


def test_kernels_with_branches_are_compiled_per_parameter():
    hazards = (Branching(((1.0, 1.0),), sharp=s) for s in (2.0, 0.5))
    sharp, blunt = (formation_objective(hazard, 2, True) for hazard in hazards)
    assert sharp.source != blunt.source


UNGUARDED = """
import casswarm as csw
csw.simulate(csw.load_scenario("paper-1"), ["naive"], 10, workers=2)
"""
DYING = """
import os, casswarm as csw
def die(step, positions, previous, alive):
    os._exit(1)
if __name__ == "__main__":
    csw.simulate(csw.load_scenario("paper-1"), [die], 10, workers=2)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "words"),
    [(UNGUARDED, "if __name__ == '__main__':"), (DYING, "a worker process died")],
    ids=["unguarded", "dying"],
)
def test_script_whose_workers_fail_ends_with_the_reason(tmp_path, script, words):
    (tmp_path / "study.py").write_text(script)
    command = [sys.executable, "study.py"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 1
    assert words in done.stderr.splitlines()[-1]


@pytest.mark.skipif(not (ROOT / "problems").exists(), reason="not in a checkout")
def test_package_is_importable_in_checkout_folder():
    code = "import casswarm.problems.guide, casswarm.cli; print('fine')"
    assert python("-c", code, folder=ROOT, PYTHONPATH="").stdout == "fine\n"

"""Recording of the problems that planning and simulation pose to their solver.

A recorder is passed to `plan` and `simulate`; it delegates every problem to another solver.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.problem import Instances, Nlp
from ..optimization.solution import BatchSolution
from ..optimization.solvers import Answer, Solver
from ..typing import FloatArray

NOISE = 0.05
"""Standard deviation by which a guide's warm start is off the solution, in steps at v_max."""


@dataclass(frozen=True, eq=False)
class Recorder(Solver):
    """Delegates to another solver, and records every problem with the answer's x."""

    inner: Solver
    records: list[tuple[Nlp, Instances, FloatArray]] = field(default_factory=list)

    name: ClassVar[str] = "recorder"
    summary: ClassVar[str] = "records the problems of another solver"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        answers = self.inner.timed_answers(nlp, instances)[1]
        self.records.append((nlp, instances, np.stack([answer.x for answer in answers])))
        return answers

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """See `Solver.solve_batch`."""
        batch = self.inner.solve_batch(nlp, instances)
        self.records.append((nlp, instances, batch.x))
        return batch

    def sample(self, count: int, rng: np.random.Generator) -> Iterator[tuple[Nlp, Instances]]:
        """Single instances of steps that are spread over the runs."""
        steps = np.linspace(0, len(self.records), count + 2)[1:-1].astype(int)
        for step in steps:
            nlp, instances, _ = self.records[step]
            row = int(rng.integers(len(instances)))
            yield nlp, instances[row : row + 1]


def guide_starts(
    instances: Instances, x: FloatArray, rng: np.random.Generator
) -> dict[str, Instances]:
    """Cold start, as it was posed, and warm start: the answer x (1, nx) with noise added."""
    near = np.where(np.isfinite(x), x, instances.x0)
    return {"cold": instances, "warm": instances.with_x0(near + NOISE * rng.normal(size=x.shape))}


def formation_starts(nlp: Nlp, instances: Instances) -> dict[str, Instances]:
    """Cold start, zero velocities as in the paper, and warm start: the previous velocities.

    They are projected onto the feasible set; over several steps the warm start is that of the
    policy.
    """
    cold = instances.with_x0(np.zeros_like(instances.x0))
    if not isinstance(instances.feasible_set, PlanarSets):
        return {"cold": cold, "warm": instances}
    return {"cold": cold, "warm": _from_previous(nlp, instances)}


def _from_previous(nlp: Nlp, instances: Instances) -> Instances:
    """The instances from the previous velocities, projected onto the feasible set."""
    sets = instances.feasible_set
    assert isinstance(sets, PlanarSets)
    previous_velocities = nlp.parameter_blocks(instances.p)["previous_velocities"]
    points = sets.project(previous_velocities.reshape(*sets.shape, 2))
    return instances.with_x0(points.reshape(instances.x0.shape))

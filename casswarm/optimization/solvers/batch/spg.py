"""The nonmonotone spectral projected gradient, compiled, over batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ...._util.jit import contiguous
from ...._util.kernel_threads import execute
from ....errors import SolverError
from ....typing import FloatArray
from ...feasible_sets.planar import PlanarSets
from ...problem import Instances, Nlp
from ..base import Capabilities
from ..options import PositiveFinite, PositiveInt
from .engine import BatchRun, BatchSolver, Results

if TYPE_CHECKING:
    from .spg_batch_kernels import Batch, Method

_PER_THREAD = 256  # instances that are worth a thread


@dataclass(frozen=True)
class SpectralProjectedGradient(BatchSolver):
    """SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000), state by state.

    For problems on products of boxes and discs with a compiled objective (`Nlp.compiled`). Newton
    steps on the active face speed up its end.

    Parameters
    ----------
    tolerance : float
        A point x has converged when no component of x - P(x - grad f(x)) is larger, all in
        `Instances.scale`: an answer does not depend on the scenario's units.
    max_iter : int, optional
        Limit for every start. By default 300 and one for every variable.
    n_starts : int, optional
        Starts of every instance: the given one and others around it, in the same pattern for every
        state. All are solved coarsely, and the least objective to tolerance. Where they do not
        agree, more follow (``multistart_kernels.py``); with 1 there is no other start. By default
        as many as the problem says are worth it (`Nlp.n_starts`).
    """

    tolerance: PositiveFinite = 1e-7
    max_iter: PositiveInt | None = None
    n_starts: PositiveInt | None = None

    name: ClassVar[str] = "spectral"
    summary: ClassVar[str] = (
        "compiled spectral projected gradient, in batches; boxes and discs only"
    )
    capabilities: ClassVar[Capabilities] = Capabilities("product sets", batch=True)

    @staticmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Whether the objective is compiled, and the feasible set a product of planar sets."""
        sets = instances.feasible_set
        return (
            nlp.compiled is not None
            and isinstance(sets, PlanarSets)
            and 2 * sets.shape[-1] == nlp.sizes[0]
        )

    def run_batch(self, nlp: Nlp, instances: Instances) -> BatchRun:
        """Solve and verify every instance.

        Stationarity is the largest component of x - P(x - grad f(x)), in `Instances.scale`; it
        needs no multipliers.
        """
        if not self.can_take(nlp, instances):
            raise SolverError(
                f"spectral cannot take {nlp.name}: it needs constraints that are products of boxes "
                "and discs in the plane, and an objective made of kernels; take auto or ipopt"
            )
        from .spg_batch_kernels import minimise_batch  # Numba takes a second to import

        assert nlp.compiled is not None
        data = batch_data(nlp, instances, instances.x0)
        results = Results.empty(instances.x0.shape)
        method = self.method(nlp.n_starts, nlp.sizes[0] // 2)
        arguments = nlp.compiled.evaluate, data, method, results
        seconds = execute(minimise_batch, len(results.x), arguments, _PER_THREAD)
        return BatchRun(results, seconds)

    def method(self, n_starts: int, members: int) -> Method:
        """The options as kernels take them, with `Nlp.n_starts` as the default."""
        from .multistart_kernels import start_displacements
        from .spg_batch_kernels import Method

        initial = self.n_starts or n_starts
        directions = start_displacements(initial, members)
        return Method(initial, directions, self.tolerance, self.max_iter or 300 + 2 * members)


def batch_data(nlp: Nlp, instances: Instances, x0: FloatArray) -> Batch:
    """Arrays of B instances and their initial guesses (B, nx) for kernels on products of sets."""
    from .spg_batch_kernels import Batch

    assert nlp.compiled is not None
    assert isinstance(instances.feasible_set, PlanarSets)
    return Batch(
        x0=contiguous(x0),
        p=contiguous(instances.p),
        constants=nlp.compiled.constants,
        scale=contiguous(instances.scale),
        sets=instances.feasible_set.packed,
    )

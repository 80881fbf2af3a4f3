"""POUNCE, an optional package: Ipopt's interior-point method in Rust, with sparse factors."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any, ClassVar

from ..._util.threads import locked_cache
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Capabilities
from .callbacks import Callbacks, CallbackSolver
from .ipopt import Ipopt
from .options import NonNegativeInt, Positive

_MISSING = "the package pounce-solver is not installed: pip install 'casswarm[pounce]'"


@dataclass(frozen=True)
class Pounce(CallbackSolver):
    """POUNCE (J. Kitchin, from version 0.13), derived from Ipopt, with exact derivatives.

    Needs the package ``pounce-solver``: ``pip install 'casswarm[pounce]'``.

    Parameters
    ----------
    tolerance : float
        Its options ``tol`` and ``constr_viol_tol``.
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    mu_init : float, optional
        Initial barrier parameter, 0.1 by default: a smaller one stays nearer to a good guess.
    """

    tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    time_limit: Positive = 60.0
    mu_init: Positive | None = None

    name: ClassVar[str] = "pounce"
    summary: ClassVar[str] = "interior point in Rust, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    # its messages are Ipopt's; others are failures: small steps, failed restoration, and errors
    statuses: ClassVar[dict[str, Status]] = Ipopt.statuses

    @classmethod
    def unavailable(cls) -> str:
        """Why the package cannot be used in this installation; empty if it can."""
        try:
            version("pounce-solver")  # another package has a module of the same name
        except PackageNotFoundError:
            return _MISSING
        return ""

    def warm(self) -> Pounce:
        """With a small initial barrier parameter, which keeps it near its initial guess."""
        return self if self.mu_init is not None else replace(self, mu_init=1e-4)

    def optimize(self, nlp: Nlp, instance: Instances) -> Any:
        """See `CallbackSolver.optimize`."""
        length = instance.scale[0, 0]
        problem = _package().Problem(
            n=nlp.sizes[0],
            m=nlp.sizes[2],
            problem_obj=Callbacks(nlp, instance),
            lb=instance.lbx[0] / length,
            ub=instance.ubx[0] / length,
            cl=instance.lbg[0],
            cu=instance.ubg[0],
        )
        for option, setting in self._options().items():
            problem.add_option(option, setting)
        return problem.solve(instance.x0[0] / length)

    def answer(self, result: Any, instance: Instances) -> Answer:
        """See `CallbackSolver.answer`."""
        (x, info), (length, value) = result, instance.scale[0]
        message = str(info["status_msg"])
        return Answer(
            x=length * x,
            status=self.statuses.get(message, Status.FAILED),
            message=message,
            iterations=int(info["iter_count"]),
            evaluations=int(info["n_obj_evals"]),
            seconds=0.0,
            multipliers=(
                value / length * (info["mult_x_U"] - info["mult_x_L"]),
                value * info["mult_g"],
            ),
        )

    def _options(self) -> dict[str, Any]:
        barrier = {} if self.mu_init is None else {"mu_init": float(self.mu_init)}
        return {
            **barrier,
            "tol": float(self.tolerance),
            "constr_viol_tol": float(self.tolerance),
            "max_iter": self.max_iter,
            "max_wall_time": float(self.time_limit),
            "bound_relax_factor": 0.0,  # or rows are violated by 1e-8 of their bounds
            "honor_original_bounds": "yes",
            "print_level": 0,
        }


@locked_cache(maxsize=1)
def _package() -> Any:
    """The package, imported so that it does not write its log to standard error."""
    before = os.environ.get("RUST_LOG")
    os.environ.setdefault("RUST_LOG", "off")  # read once, by the import
    try:
        import pounce  # slow to import, and optional
    finally:
        if before is None:
            del os.environ["RUST_LOG"]
    return pounce

"""Solvers that are not supported, each with the reason."""

from __future__ import annotations

NOT_SHIPPED = "CasADi's wheel contains only the interface, not the library"

UNSUPPORTED: dict[str, str] = {
    "fatrop": (
        "converges on 38 of 43 trial problems, but never returns if the objective becomes NaN "
        "at an iterate, and neither a time limit nor Ctrl-C stops it (casadi 3.8.2)"
    ),
    "trust-constr": (
        "reports success while its barrier parameter is still large: the objective is off by 1e-6 "
        "to 1e-3 on 20 of 43 trial problems (scipy 1.17.1)"
    ),
    "blocksqp": (
        "correct on 34 of 43 trial problems, but not on the guide; its restoration phase needs "
        "HSL's MA27, and it reports no status (casadi 3.8.2)"
    ),
    "feasiblesqpmethod": (
        "correct on 14 of 43 trial problems: it raises on formations and refuses infeasible starts "
        "(casadi 3.8.2)"
    ),
    "qrsqp": "correct on 22 of 43 trial problems, raises on 15 (casadi 3.8.2)",
    "scpgen": "correct on 17 of 43 trial problems, raises on 21 (casadi 3.8.2)",
    "bonmin": "for integer variables; without any it calls Ipopt, and reports no multipliers",
    "jaxipm": "needs Python 3.12 and jax for CUDA 13, hence a graphics processor (jaxipm 0.0.1)",
    "cyipopt": (
        "the same solver as ipopt, with MUMPS, called from Python: correct on the same 42 of 43 "
        "trial problems, in four times the time (cyipopt-wheels 1.7.0.dev0)"
    ),
    "ampl": "writes a file for an executable that is not shipped",
    **dict.fromkeys(("worhp", "snopt", "knitro", "conopt", "madnlp", "ccopt"), NOT_SHIPPED),
}
"""Reason by name. The trial problems are 38 of Hock and Schittkowski, four formations of five
members and the guide of paper-1; correct is the published (or Ipopt's) objective to 1e-6."""

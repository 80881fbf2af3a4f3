from .confidence import Paired, required_runs, wilson
from .distribution import Estimate
from .exact import ExpansionOptions, StateSpaceExpansion, sample_residual
from .monte_carlo import Chain, Purpose, RunTrajectory, uniforms, write_uniforms
from .transition import Lattice

__all__ = [
    "Chain",
    "Estimate",
    "ExpansionOptions",
    "Lattice",
    "Paired",
    "Purpose",
    "RunTrajectory",
    "StateSpaceExpansion",
    "required_runs",
    "sample_residual",
    "uniforms",
    "wilson",
    "write_uniforms",
]

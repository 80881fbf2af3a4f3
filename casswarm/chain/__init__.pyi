from .confidence import Paired, required_runs, wilson
from .exact import ExpansionOptions, StateSpaceExpansion
from .monte_carlo import Chain, Purpose, RunTrajectory
from .random_stream_kernels import write_uniforms
from .stratified import Estimate, sample_residual
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
    "wilson",
    "write_uniforms",
]

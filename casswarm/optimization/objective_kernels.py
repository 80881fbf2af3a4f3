"""Constants of objectives; kernels are compiled again where a file of this kind changes."""

LARGE_SWARM = 16
"""Members from which on compiled solvers use the diagonal blocks of an objective's Hessian."""

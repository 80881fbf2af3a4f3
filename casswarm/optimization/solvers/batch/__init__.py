"""Compiled solvers for batches of small problems, and the kernels that they call."""

"""Constants of compiled loops; kernels are compiled again where a file of this kind changes."""

LANES = 64
"""Number of instances for which an operation is done before the next one."""

EQUALITY, FIXED = 1e8, 1e20
"""Weights of rows of g, and of variables, with equal bounds, instead of infinite ones."""

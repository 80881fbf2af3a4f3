"""The width of compiled loops; kernels are compiled again where a file of this kind changes."""

LANES = 64
"""Number of instances for which an operation is done before the next one."""

"""Number of instances for which compiled loops do an operation before the next one."""

LANES = 64

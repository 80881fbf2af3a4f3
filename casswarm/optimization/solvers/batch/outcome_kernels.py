"""Outcomes of a solve; kernels are compiled again where a file of this kind changes."""

CONVERGED, EXHAUSTED, STALLED, NOT_FINITE, NO_INTERIOR = range(5)

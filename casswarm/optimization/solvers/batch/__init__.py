"""Compiled solvers for batches of small problems."""

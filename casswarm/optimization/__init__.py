"""Nonlinear programs: problems, instances, solvers, residuals."""

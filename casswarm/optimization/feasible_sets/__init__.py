"""Feasible sets that projection and interior-point methods work on."""

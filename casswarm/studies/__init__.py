"""Studies: simulate, evaluate, estimate, sweep."""

"""The guide trajectory, bounds on it, and joint plans."""

"""A primal-dual interior-point method for any program, over batches of instances."""

"""Compiled code: kernels, how they are linked, their threads, and the files that keep them."""

"""A results folder: written, read back, drawn and reported."""

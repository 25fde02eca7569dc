"""Counts of the work of GPUs, made without a GPU."""

"""Counts of what GPUs are given to do, made without one."""

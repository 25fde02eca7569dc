"""Benchmarks for GPUs: work counted without a GPU, and measurements on a real one."""

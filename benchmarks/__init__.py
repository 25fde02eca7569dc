"""Measures pyibr's times, work and memory, and compares them with the papers' figures and with other libraries.

``python -m benchmarks`` measures and writes JSON; ``python -m benchmarks.report DIR`` makes tables and plots from it.
"""

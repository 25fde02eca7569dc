"""Times, counts and memory of pyibr, compared with the papers' figures and today's peers.

``python -m benchmarks`` measures and writes JSON; ``python -m benchmarks.report DIR`` makes tables and plots from it.
"""

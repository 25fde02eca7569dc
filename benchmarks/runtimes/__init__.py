"""The CPU runtimes of a machine."""

"""Foundations of pyibr: cameras, their maps, errors, checks."""

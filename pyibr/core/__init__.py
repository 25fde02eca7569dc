"""Foundations of all of pyibr: cameras, their maps, errors, checks."""

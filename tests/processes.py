"""Environments of processes that tests start."""

from __future__ import annotations

import os
import sys


def with_path(**more: str) -> dict[str, str]:
    """This process's environment and path, and some more variables."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)} | more

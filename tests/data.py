"""Real inputs, which are not part of the project: beside the checkout, or where PYIBR_DATA says."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("PYIBR_DATA") or Path(__file__).parents[2] / "shared" / "data")


def shared(name: str) -> Path:
    """A file or folder there; the test is skipped without it."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs {name}")
    return path

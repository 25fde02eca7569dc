"""Skips tests whose formats need a missing package, and gives tests a folder in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def folder() -> Iterator[Path]:
    """A temporary folder, in memory if possible."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as place:
        yield Path(place)


@pytest.fixture
def openexr_if_asked(request: pytest.FixtureRequest) -> None:
    """If OpenEXR is missing, skip test cases that name EXR in their parameters."""
    if "exr" in str(getattr(request.node, "callspec", None) and request.node.callspec.params):
        pytest.importorskip("OpenEXR")

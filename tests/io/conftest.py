"""Skips tests whose formats need a missing package, and gives tests a folder in memory."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.io.damages import quick_folder


@pytest.fixture
def folder() -> Iterator[Path]:
    """A temporary folder, in memory if possible."""
    place = quick_folder()
    yield place
    shutil.rmtree(place)


@pytest.fixture
def openexr_if_asked(request: pytest.FixtureRequest) -> None:
    """If OpenEXR is missing, skip test cases that name EXR in their parameters."""
    if "exr" in str(getattr(request.node, "callspec", None) and request.node.callspec.params):
        pytest.importorskip("OpenEXR")

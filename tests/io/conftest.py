"""Skips tests whose formats need a missing package."""

from __future__ import annotations

import pytest


@pytest.fixture
def openexr_if_asked(request: pytest.FixtureRequest) -> None:
    """If OpenEXR is missing, skip test cases that name EXR in their parameters."""
    if "exr" in str(getattr(request.node, "callspec", None) and request.node.callspec.params):
        pytest.importorskip("OpenEXR")

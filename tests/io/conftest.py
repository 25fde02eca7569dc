"""Fixtures for packages that some formats need."""

from __future__ import annotations

import pytest


@pytest.fixture
def openexr_if_asked(request: pytest.FixtureRequest) -> None:
    """Skip a test case whose parameters name EXR if OpenEXR is missing."""
    if "exr" in str(getattr(request.node, "callspec", None) and request.node.callspec.params):
        pytest.importorskip("OpenEXR")

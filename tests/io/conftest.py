"""Packages that some formats need."""

from __future__ import annotations

import pytest


@pytest.fixture
def openexr_if_asked(request: pytest.FixtureRequest) -> None:
    """Cases of a test that name the format are skipped where the package is missing."""
    if "exr" in str(getattr(request.node, "callspec", None) and request.node.callspec.params):
        pytest.importorskip("OpenEXR")

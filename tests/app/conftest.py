"""Scenes in files, which tests of several commands use."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.app.plane import Scene
from tests.app.recorded import Recorded


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return Recorded(tmp_path)

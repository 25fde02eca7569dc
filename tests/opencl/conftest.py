"""Fixtures that several test files use."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from pyibr.opencl import cache, device, headers, probe
from pyibr.opencl.device import current
from pyibr.opencl.program import keeping_binaries


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """An empty cache; earlier warnings and tests of devices are forgotten. A device is open, unless `nothing_open`."""
    if "nothing_open" not in request.fixturenames:
        current()
    monkeypatch.setattr(probe, "_tested", {})
    monkeypatch.setattr(cache, "_warned", set())
    monkeypatch.setenv("PYIBR_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def binaries() -> Iterator[None]:
    """Keep the binaries of all programs, whatever the runtime."""
    with keeping_binaries():
        yield


@pytest.fixture
def nothing_open(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Reset the process to the state before it opens a device."""
    device._default_session.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(device, "_sessions", {})
        patch.setattr(device, "_failed_here", {})
        yield
    device._default_session.cache_clear()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the kernels, in a folder with a space; nothing is built or read yet, and the cache is empty."""
    copy = tmp_path / "a b" / "kernels"
    shutil.copytree(headers.kernels_folder(), copy)
    monkeypatch.setattr(headers, "kernels_folder", lambda: copy)
    monkeypatch.setenv("PYIBR_CACHE", str(tmp_path / "cache"))
    kept = dict(current().kernels)
    current().kernels.clear()
    _forget_headers()
    yield copy
    _forget_headers()
    current().kernels.clear()
    current().kernels.update(kept)


def _forget_headers() -> None:
    for read in (headers.struct, headers.constant, headers._source, headers._own_text):
        read.cache_clear()

"""Tiers of tests: `make test` runs tests not marked as thorough, `make test-all` tests not marked as product."""

from __future__ import annotations

import os

import pytest

from pyibr.opencl.device import VARIABLE, current
from pyibr.opencl.runtimes import found_devices
from tests.tiers import COLLECTED, LEFT, leave_products

os.environ.setdefault("PYIBR_BINARIES", "never")  # most are built once; reading them compiles them twice
os.environ.setdefault("PYIBR_BUILD_OPTIONS", "-Werror")


def pytest_configure() -> None:
    # The fastest of several runtimes is stored in a cache that some tests damage.
    if len(found_devices()) > 1:
        os.environ.setdefault(VARIABLE, current().device.platform)


@pytest.hookimpl(tryfirst=True)  # before -m selects
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    leave_products(items)
    config.stash[COLLECTED] = {item.nodeid: {left for left in LEFT if item.get_closest_marker(left)} for item in items}

"""The tiers of tests: `make test` runs what is not marked as thorough, `make test-all` what is no marked product."""

from __future__ import annotations

import os

import pytest

from pyibr.opencl.device import VARIABLE, current
from pyibr.opencl.runtimes import found_devices
from tests.tiers import COLLECTED, LEFT, leave_products

os.environ.setdefault("PYIBR_BINARIES", "never")  # most programs are built once, and to read them compiles them twice
os.environ.setdefault("PYIBR_BUILD_OPTIONS", "-Werror")


def pytest_configure() -> None:
    # Which of several runtimes is the fastest stands in a cache that some tests damage.
    if len(found_devices()) > 1:
        os.environ.setdefault(VARIABLE, current().device.platform)


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    leave_products(items)
    config.stash[COLLECTED] = {item.nodeid: {left for left in LEFT if item.get_closest_marker(left)} for item in items}

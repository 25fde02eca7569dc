"""Tiers of tests: `make test` runs tests not marked as thorough, `make test-all` tests not marked as product."""

from __future__ import annotations

import os

import pytest

from tests.tiers import COLLECTED, LEFT, leave_products

os.environ.setdefault("PYIBR_BUILD_OPTIONS", "-Werror")


@pytest.hookimpl(tryfirst=True)  # before -m selects
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    leave_products(items)
    config.stash[COLLECTED] = {item.nodeid: {left for left in LEFT if item.get_closest_marker(left)} for item in items}

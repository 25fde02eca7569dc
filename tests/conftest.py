"""Tiers of tests: `make test` runs tests not marked as thorough, `make test-all` tests not marked as product."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import nullcontext

import pytest

from tests.tiers import COLLECTED, LEFT, leave_products

os.environ.setdefault("PYIBR_BUILD_OPTIONS", "-Werror")


@pytest.hookimpl(tryfirst=True)  # before -m selects
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    leave_products(items)
    config.stash[COLLECTED] = {item.nodeid: {left for left in LEFT if item.get_closest_marker(left)} for item in items}


@pytest.fixture(params=[16, pytest.param(1, marks=pytest.mark.thorough)])
def lanes(request: pytest.FixtureRequest) -> Iterator[int]:
    """Run a test with the device's own form of the kernels and, in the thorough tier, with that of one lane."""
    from tests.one_lane import one_lane  # after the variable above is set

    with one_lane() if request.param == 1 else nullcontext():
        yield request.param

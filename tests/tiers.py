"""The two tiers of tests: which tests of a product of parameters are enough to meet every value."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence, Set

import pytest

COLLECTED = pytest.StashKey[dict[str, bool]]()
"""All tests that were found, and whether `make test` runs them."""


def covering(places: Sequence[Set[Hashable]]) -> set[int]:
    """Numbers of so many places in a product that each value is in one of them."""
    missing, chosen = set[Hashable]().union(*places), set[int]()
    while missing:
        best = max(range(len(places)), key=lambda number: len(places[number] & missing))  # of equal ones the first
        chosen.add(best)
        missing -= places[best]
    return chosen


def values_of(test: pytest.Function) -> frozenset[tuple[str, tuple[int, ...]]]:
    """Each axis of a test's parameters, with the object in the axis' list that is the test's value."""
    names = [mark.args[0] for mark in test.iter_markers("parametrize")]
    axes = [given.replace(",", " ").split() if isinstance(given, str) else list(given) for given in names]
    params = test.callspec.params
    axes += [[name] for name in params if not any(name in axis for axis in axes)]  # of fixtures
    return frozenset((axis[0], tuple(id(params[name]) for name in axis)) for axis in axes)


def leave_products(items: Iterable[pytest.Item]) -> None:
    """Mark as thorough what a test whose parameters multiply has beyond those that are enough."""
    of_function: dict[str, list[pytest.Function]] = defaultdict(list)
    for item in items:
        if isinstance(item, pytest.Function) and hasattr(item, "callspec") and not item.get_closest_marker("thorough"):
            of_function[item.nodeid.split("[")[0]].append(item)
    for tests in of_function.values():
        values = [values_of(test) for test in tests]
        if len(values[0]) > 1:
            for number in set(range(len(tests))) - covering(values):
                tests[number].add_marker("thorough")

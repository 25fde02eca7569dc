"""Combinations of test parameters: which of them `make test` and `make test-all` run."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Sequence, Set
from itertools import combinations

import pytest

LEFT = "thorough", "product"
"""Markers: `make test` skips tests with either marker, `make test-all` skips tests marked "product"."""
COLLECTED = pytest.StashKey[dict[str, set[str]]]()
"""All collected tests, each with its markers from `LEFT`."""
DRAWING = {"capture", "cleaning", "depthmesh", "gaussians", "picture", "raster", "relief", "slicing", "warp"}
"""Folders whose tests draw."""
_DRAWN = 2  # cases of such a test that `make test` runs


def covering(places: Sequence[Set[Hashable]], first: Collection[int] = ()) -> list[int]:
    """Choose sets, by index, that together contain every value of all sets, sets with more missing values earlier.

    Sets in `first` are always chosen.
    """
    chosen = list(first)
    missing = set[Hashable]().union(*places).difference(*(places[number] for number in chosen))
    while missing:
        best = max(range(len(places)), key=lambda number: len(places[number] & missing))  # the first among equals
        chosen.append(best)
        missing -= places[best]
    return chosen


def values_of(test: pytest.Function) -> frozenset[tuple[str, tuple[int, ...]]]:
    """The test's parameters: for each `parametrize` mark or fixture, a name and the identities of the values."""
    names = [mark.args[0] for mark in test.iter_markers("parametrize")]
    axes = [given.replace(",", " ").split() if isinstance(given, str) else list(given) for given in names]
    params = test.callspec.params
    axes += [[name] for name in params if not any(name in axis for axis in axes)]  # parameters of fixtures
    return frozenset((axis[0], tuple(id(params[name]) for name in axis)) for axis in axes)


def leave_products(items: Iterable[pytest.Item]) -> None:
    """Mark combinations of parameters that the quicker tiers need not run.

    A combination is marked "thorough" if the others cover every value without it, or if two others of a test that
    draws cover more values; and "product" if the others cover every pair of values of two parameters without it.
    """
    of_function: dict[str, list[pytest.Function]] = defaultdict(list)
    for item in items:
        if isinstance(item, pytest.Function) and hasattr(item, "callspec"):
            of_function[item.nodeid.split("[")[0]].append(item)
    for tests in of_function.values():
        tests.sort(key=lambda test: test.get_closest_marker("thorough") is not None)
        quick = [values_of(test) for test in tests if not test.get_closest_marker("thorough")]
        enough = covering(quick) if quick and len(quick[0]) > 1 else [*range(len(quick))]
        pairs = [set(combinations(sorted(values_of(test)), 2)) for test in tests]
        with_pairs = covering(pairs, enough) if len(pairs[0]) > 1 else range(len(tests))
        if DRAWING & {*tests[0].path.parts}:
            enough = enough[:_DRAWN]
        for number, test in enumerate(tests):
            for marker, kept in zip(LEFT, (enough, with_pairs), strict=True):
                if number not in kept:
                    test.add_marker(marker)
